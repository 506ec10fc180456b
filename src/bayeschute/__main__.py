"""The command ``bayeschute`` as ``python -m bayeschute``, where the installed one is not on the path."""

from bayeschute.cli import main

if __name__ == "__main__":
    main()
