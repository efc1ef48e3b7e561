"""DIDIM's columns against the exact ones: when the approximation is good enough, and what exactness buys."""
