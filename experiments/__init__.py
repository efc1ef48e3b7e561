"""Studies: thin modules that call the package and write a run folder, `python -m experiments.NAME --out DIR`."""
