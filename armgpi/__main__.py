"""``python -m armgpi``."""

from armgpi.cli import main

if __name__ == "__main__":  # not in the workers of a sweep, which import this
    main()
