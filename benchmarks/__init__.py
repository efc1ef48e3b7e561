"""Timings beside peers; each is a program of its own."""
