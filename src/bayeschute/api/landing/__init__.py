"""Landings from Python and from the shell: results, simulation, further analyses, files."""
