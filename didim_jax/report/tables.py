"""The parameter table as plain text, for the page and for the terminal. Numbers are rounded here and nowhere else."""

import dataclasses
import math

import numpy as np

from ..identify.result import IdentificationResult

NOT_GIVEN = "not given by this record"
NO_NUMBER = "–"


@dataclasses.dataclass(frozen=True)
class Row:
    """One parameter, its numbers rounded to the digits that the standard deviation carries.

    `uncertainty` is the larger of the two standard deviations: a residual that is not white can make either of them the
    flattering one, and the relative one is of it. `given` is False where there is no estimate: `value` then says so,
    the other cells are empty.
    """

    name: str
    value: str
    std: str
    std_autocorrelated: str
    relative_std_percent: str
    unit: str
    uncertainty: str = ""
    given: bool = True

    @property
    def estimate(self) -> str:
        """'M = 95.15 ± 0.26 kg': one standard deviation."""
        spread = f" ± {self.uncertainty}" if self.uncertainty != NO_NUMBER else ""
        return f"{self.name} = {self.value}{spread}{f' {self.unit}' if self.unit else ''}"


def parameter_rows(result: IdentificationResult, lost: tuple[str, ...] = ()) -> list[Row]:
    """One row per parameter, in the result's order; then those among `lost` that the result does not even name.

    A parameter that the record does not give is never shown as a number, whatever the least squares made of it.
    """
    rows = []
    for i, (name, unit) in enumerate(zip(result.names, result.units, strict=True)):
        unit = "" if unit == "1" else unit
        theta, white, any_spectrum = (float(x[i]) for x in (result.theta, result.std, result.std_autocorrelated))
        if name in lost or not math.isfinite(theta):
            rows.append(_absent(name, NOT_GIVEN if name in lost else "no estimate", unit))
            continue
        larger = float(np.nanmax([white, any_spectrum, -1.0]))
        known = larger > 0 and abs(theta) > 1e-9 * larger
        relative = significant(100 * larger / abs(theta), 2) if known else NO_NUMBER
        cells = (rounded(theta, decimals(larger)), _std(white), _std(any_spectrum), relative)
        rows.append(Row(name, *cells, unit, uncertainty=_std(larger)))
    return rows + [_absent(name, NOT_GIVEN, "") for name in lost if name not in result.names]


def _absent(name: str, why: str, unit: str) -> Row:
    return Row(name, why, "", "", "", unit, given=False)


def _std(std: float) -> str:
    place = decimals(std)
    return NO_NUMBER if place is None else rounded(std, place)


def decimals(std: float) -> int | None:
    """Decimal places that a standard deviation carries: two digits up to 354, else one; None where it says nothing.

    References: Particle Data Group, *Review of Particle Physics*, introduction, section 5.3 (rounding).
    """
    if not (math.isfinite(std) and std > 0):
        return None
    exponent = math.floor(math.log10(std))
    return (1 if std / 10.0**exponent < 3.545 else 0) - exponent


def rounded(x: float, places: int | None) -> str:
    """x to so many decimal places (negative: tens, hundreds), at most seven digits; with None to five digits."""
    if not math.isfinite(x):
        return NO_NUMBER
    if places is None:
        return f"{x + 0.0:.5g}"
    # Noise-free data has a standard deviation of rounding errors: no one reads fifteen digits.
    places = min(places, 6 - math.floor(math.log10(abs(x))) if x else 3)
    value = round(x, places) + 0.0  # no minus zero
    if value and not 1e-4 <= abs(value) < 1e7:
        return f"{value:.{max(math.floor(math.log10(abs(value))) + places, 0)}e}"
    return f"{value:.{max(places, 0)}f}"


def significant(x: float, digits: int) -> str:
    """x to so many significant digits, without an exponent where a person would write none: 412 %, 0.11 %."""
    if not math.isfinite(x):
        return NO_NUMBER
    return rounded(x, digits - 1 - math.floor(math.log10(abs(x)))) if x else "0"


def percent(ratio: float) -> str:
    """A ratio in percent, three significant digits: 0.04219 -> '4.22 %'."""
    return NO_NUMBER if not math.isfinite(ratio) else f"{significant(100 * ratio, 3)} %"
