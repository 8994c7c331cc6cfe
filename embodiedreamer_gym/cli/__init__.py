"""The command `embodiedreamer`, one file a verb."""

from embodiedreamer_gym.cli.command import main

__all__ = ["main"]
