"""Stages of a run, each cached and resumable."""
