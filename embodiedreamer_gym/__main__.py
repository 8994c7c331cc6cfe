"""`python -m embodiedreamer_gym` runs the command `embodiedreamer`."""

from embodiedreamer_gym.cli.command import main

if __name__ == "__main__":
    raise SystemExit(main())
