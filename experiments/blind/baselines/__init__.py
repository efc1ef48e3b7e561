"""Simple rivals of the diagnosis, one file a method: each names an effect, or none, from the same record."""
