"""`python -m didim_jax` is the `didim` command."""

from .cli import main

main()
