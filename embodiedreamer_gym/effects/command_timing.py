"""Errors of the times at which commands act: never named as an effect, but taken into account in intervals."""

from embodiedreamer_gym.effects.effect import Parameter, SignalLaw


class CommandTiming(SignalLaw):
    """Commands act a little later or, below zero, earlier than the log says, relative to its positions.

    A servo works in ticks of about 1 ms: it acts on a command and on a position up to one tick after both, and holds
    its torque until the next tick. A command that is logged at its tick is half a tick early relative to the position
    that the servo uses. The typical size, half of 1 ms, is the standard deviation of the prior.
    """

    name = "command_timing"
    stage = "command"
    parameters = (Parameter("seconds", "s", off=0.0, low=-0.003, high=0.003, typical=0.0005, prior=True),)
    symptom = "the whole motion is late or early by a part of the servo's tick"
    reveals = "the servo's manual"

    @staticmethod
    def start(signal, p, dt):
        """The last command (B, n), and the step, s."""
        return signal, dt

    @staticmethod
    def law(signal, joint, memory, p):
        """The line through the last two commands, evaluated that time ago."""
        last, dt = memory
        return signal + p.seconds / dt * (last - signal), (signal, dt)
