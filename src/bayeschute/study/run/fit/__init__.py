"""Parts of the stage `fit`: terms settled on, several starts and structures, checkpoints."""
