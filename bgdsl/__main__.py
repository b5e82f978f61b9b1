"""`python -m bgdsl`."""

from bgdsl.cli import main

if __name__ == "__main__":
    main()
