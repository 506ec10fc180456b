"""Equations of motion of capsule, canopies and risers, and of a point mass under drag."""
