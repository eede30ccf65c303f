"""`python -m texsss`: the command line where its script is not on the path."""

from texsss.cli import main

if __name__ == "__main__":
    main()
