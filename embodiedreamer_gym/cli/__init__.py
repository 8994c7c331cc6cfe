"""The command `embodiedreamer`; one file per verb."""

from embodiedreamer_gym.cli.command import main

__all__ = ["main"]
