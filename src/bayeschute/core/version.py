"""The program's version: it rises whenever numerics change, as results are then no longer the same."""

__version__ = "0.2.0"
