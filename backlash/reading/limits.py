"""The rules by which a log is read, in one table: each limit with its unit and its reason."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Limits:
    """What is refused, left out, filled or averaged on the way from stamps to a record of constant speed."""

    # Files.
    most_bytes: int = 64 * 2**20  # of a log, packed or not
    most_style_bytes: int = 2 * 2**20  # of a workbook's parts but its sheets and texts
    most_style_tags: int = 100_000  # of these parts: some seconds
    most_cells: int = 8_000_000  # of a table: an hour at 500 Hz of four columns
    most_columns: int = 4096
    most_list_bytes: int = 16 * 2**20  # of a table of logs
    most_logs: int = 100_000  # of such a table: the parent holds 3 kB for each

    # Time stamps.
    most_hz: float = 1e6  # no logger samples faster; the stamps have another unit
    since_1970_s: tuple[float, float] = (1e9, 4e9)  # from 2001 to 2096
    # What misses more than both is a gap; less is filled, a fifth of the ring's period at most.
    longest_step: float = 3.5  # in sampling periods
    longest_filled_s: float = 0.010
    few_gaps: float = 0.02  # of the steps; more are bursts or lost samples
    most_invented: float = 0.1  # of the samples; above, the stamps are not those of the samples

    least_names: int = (
        100  # of signals; a table that names fewer, row after row, has a row for each value
    )

    # Samples in a period of the ring.
    least_rate: float = 4  # with half as many, two of 17 simulated joints were wrong
    good_rate: float = 12  # with fewer, the samples may miss more than 3 % of a peak
    fastest_hz: float = 2000.0  # above, neighbouring samples are averaged

    # The movement.
    least_ratio: float = 0.9  # motor turns in a load turn; 1 for the joint's side
    fastest_rps: float = 500.0  # of a motor, 30000 rpm; above, the unit is another one
    least_samples: int = 8  # of a log, and of a load turn
    least_turns: int = (
        4  # fewer half turns have too few orders of signs to tell a pattern from noise
    )
    most_turns: int = 60  # what is beyond adds nothing but time
    # Of a speed beside the one that was said, and of turns alike; backlash disturbs it by some 1 %.
    tolerance: float = 0.03
    most_drift: float = 0.01  # of the mean of whole turns
    smoothing_s: float = 0.1  # two periods of the ring, a fraction of a turn

    # Signals that are not those of a motor.
    spike: float = 0.3  # of the speed, within a sample: no motor's torque does that
    stray: float = 3.0  # of the torque's range, and in medians of all deviations; an impact's single sample 1.2
    stray_deviations: float = 20.0
    most_single: float = 0.01  # of the samples; more are no single ones
    least_frozen: int = 8  # samples of one value
    least_beneath: int = (
        2  # times that a coarse signal stands for half as long or longer, beside its longest
    )
    rare: float = 0.01  # of the steps; smaller ones come from values that a logger filled in
    least_leap: float = 3.0  # in the finest steps; a coarse signal moves by one
    least_held: float = 0.25  # of the values, that stand more than one sample
    longest_hold: int = 50  # samples; what stands longer rests, or is frozen
    most_regular: float = 0.95
    least_values: int = 16  # of a signal that is not merely coarse
    # Samples at a limit over those at a level beside it; of a sine that is rounded 2.4 at most.
    least_piled: float = 4.0
    most_clipped: float = 0.005  # of the samples, at a limit three or more in a row


LIMITS = Limits()
