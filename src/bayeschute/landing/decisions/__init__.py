"""Decisions from landings: probability of meeting limits and its uncertainty, sensitivity, the next test."""
