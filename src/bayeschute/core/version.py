"""The program's version; it rises whenever numerics change, because stored results are then no longer comparable."""

__version__ = "0.2.0"
