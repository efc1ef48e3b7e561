"""Study `robustness`: from which starts, and under which mistakes, does each method still end at the machine?"""
