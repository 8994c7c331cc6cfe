"""Exceptions of the package: each message is one sentence that says what was given and what is allowed."""

MOST = 1200  # characters of a message


class EmbodieDreamerError(ValueError):
    """Base class of all errors that user input can cause."""

    def __str__(self) -> str:
        """The message on one line; if it is longer than MOST characters, its middle is left out."""
        text = " ".join(super().__str__().splitlines())
        return text if len(text) <= MOST else f"{text[: MOST // 2]} ... {text[-MOST // 3 :]}"


class RecordingError(EmbodieDreamerError):
    """A log cannot be used as it is."""


class ModelError(EmbodieDreamerError):
    """A robot model, its JSON or its URDF cannot be used as it is."""


class EffectError(EmbodieDreamerError):
    """A physical effect is unknown or violates one of the rules that every effect must follow."""


class RobotError(EmbodieDreamerError):
    """A real robot cannot be moved as asked, or its motion was stopped."""


class SimulationError(EmbodieDreamerError):
    """A simulation cannot run or has diverged."""


class CalibrationError(EmbodieDreamerError):
    """A calibration or a diagnosis cannot be carried out with this model and these recordings."""


class MissingExtraError(EmbodieDreamerError, ImportError):
    """An optional dependency is missing; the message gives the `pip install` command for it."""


class VisionError(EmbodieDreamerError):
    """Pictures, masks, a camera or a video model cannot be used as they are."""


class PolicyError(EmbodieDreamerError):
    """A policy, its checkpoint or its training data cannot be used as they are."""


def brief(value: object, most: int = 60) -> str:
    """A value for a message: its `repr` on one line of at most `most` characters; its type if `repr` fails."""
    try:
        text = " ".join(repr(value).split())
    except Exception:  # a number too long to print, a nesting too deep, or whatever an object's own repr raises
        text = f"a {type(value).__name__}"
    return text if len(text) <= most else f"{text[: most - 3]}..."
