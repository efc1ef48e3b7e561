"""Every number of the paper beside ours, on the synthetic twin: `python -m experiments.paper --out runs/paper`."""
