"""The answer on one log."""

from dataclasses import dataclass

from backlash import __version__
from backlash.fitting import SELF, TORQUE
from backlash.refusals import one_line


@dataclass(frozen=True)
class Estimate:
    """The answer on one log; what is not known is None. The backlash is half of the total play; `print` shows it."""

    file: str
    verdict: str = "cannot tell"  # or "backlash", "no backlash"
    amplitude_rps: float | None = None  # of the oscillation after an impact
    amplitude_interval_rps: tuple[float, float] | None = None  # 95 %
    backlash_rad: float | None = None  # half of the play: the teeth are free over twice that
    backlash_interval_rad: tuple[float, float] | None = None  # 95 %
    rmse_rps: float | None = None  # misfit of the fitted model
    method: str = SELF
    turn_period_s: float | None = None  # of the load
    samples: int = 0  # of the record that was used
    # The reason first where the verdict is "cannot tell", then what was assumed.
    warnings: tuple[str, ...] = ()
    sha256: str | None = None  # of the log file's bytes
    calibration: str = ""  # what it was made from

    def to_dict(self) -> dict[str, object]:
        """The attributes in order, ready for JSON, then the total play and the version."""
        half, ends = self.backlash_rad, self.backlash_interval_rad
        row = {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in vars(self).items()
        }
        return row | {
            "total_play_rad": None if half is None else 2 * half,
            "total_play_interval_rad": ends and [2 * end for end in ends],
            "version": __version__,
        }

    def __str__(self) -> str:
        """The answer for people: a line with it, then one for each number and each warning."""
        notes = self.warnings
        if self.backlash_rad is None or self.backlash_interval_rad is None:
            answer, notes = f"cannot tell: {notes[0]}", notes[1:]
        elif self.verdict == "no backlash":
            less = f"less than {1e3 * self.backlash_interval_rad[1]:.3f} mrad, half of the play"
            answer = f"no backlash ({less})"
            if self.method != TORQUE:
                answer = (
                    f"no backlash seen ({less}); valid only if the load's friction is below gravity"
                )
        else:
            low, high = (1e3 * end for end in self.backlash_interval_rad)
            answer = f"backlash {1e3 * self.backlash_rad:.3f} mrad (half of the play; 95 %: {low:.3f} to {high:.3f})"
        lines = [one_line(f"{self.file}: {answer}")]
        if self.amplitude_rps and self.amplitude_interval_rps:
            low, high = self.amplitude_interval_rps
            lines.append(
                f"  amplitude {self.amplitude_rps:.3f} rps ({low:.3f} to {high:.3f}), method {self.method}"
            )
            if self.verdict == "cannot tell":
                lines[-1] += (
                    "; a relative index: compare it only with logs of this joint in this movement"
                )
        if self.rmse_rps is not None:
            turn = f"turn of {self.turn_period_s:.5g} s"
            lines.append(f"  misfit {self.rmse_rps:.3f} rps, {self.samples} samples, {turn}")
        return "\n".join([*lines, *(f"  note: {one_line(note)}" for note in notes)])
