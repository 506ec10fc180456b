"""Tables of study and vehicle files, their units and their faults."""
