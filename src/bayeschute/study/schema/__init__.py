"""Tables of study and vehicle files, their units and the faults they may have."""
