"""The diagnosis checked blind: cases whose answers are sealed before anything is diagnosed, and opened once after.

`python -m experiments.blind make | seal | diagnose | open | score | report STUDY`; `seal` says what an outside team
brings.
"""
