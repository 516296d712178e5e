"""Logs of one joint over months: the joint is told by all of them together."""

from collections.abc import Sequence
from pathlib import Path

from replication.methods.self_calibration import fit_joint
from replication.methods.shared_joint import share_joint
from replication.sensor.many import Row
from replication.sensor.verdict import Settings, prepared


def with_shared_joint(logs: Sequence[Path], rows: Sequence[Row], settings: Settings) -> list[Row]:
    """Correct estimates by method self by what all logs tell of their joint; rows without a backlash stay."""
    answered = [k for k, row in enumerate(rows) if row["verdict"] == "backlash"]
    fits = [fit_joint(prepared(logs[k], settings.form, settings.seed, [])[0]) for k in answered]
    corrected = list(rows)
    for k, (delta, interval) in zip(answered, share_joint(fits) if fits else [], strict=True):
        corrected[k] = rows[k] | {"backlash_rad": delta, "backlash_interval_rad": list(interval)}
    return corrected
