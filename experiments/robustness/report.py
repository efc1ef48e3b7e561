"""ranges.json and report.html: the answer in words, filled from what was computed."""

import dataclasses
import json
from pathlib import Path

import xarray as xr

from ..page import Picture, Section, Tabular, Text, picture, write_page
from . import conditions, figures, global_start, mode_start, no_start, rigid_start
from .job import DIDIM, EXACT, SAFE_DIDIM, Count, count
from .maps import OneLaw, Results

_SOURCE = (
    "Every record here is SYNTHETIC: the twin of the paper's drive (its Table 3), simulated by this program, with "
    "white force noise of {noise:g} N rms at 1 kHz added to the recorded force, from rest; without a start, other "
    "machines are drawn. The same laws make the records and are fitted to them. No measurement takes part; what the "
    "paper reports is named as such."
)


def ranges(results: Results) -> dict[str, object]:
    """All counts and ranges, as `ranges.json` holds them."""
    said: dict[str, object] = {}
    for law, one in results.laws.items():
        said[law] = {
            "step 1": {m: rigid_start.ranges(lanes) for m, lanes in one.step1.items()},
            "step 2": {m: mode_start.ranges(lanes) for m, lanes in one.step2.items()},
            "step 2, where the criterion is least": one.minimum,
            "step 3": {m: global_start.ranges(lanes) for m, lanes in one.step3.items()},
            "error of the fast integration, relative": one.integration_error,
        }
    said["mistakes"] = {
        name: {m: conditions.ranges(lanes) for m, lanes in methods.items()}
        for name, methods in results.conditions.items()
    }
    said["beginning of the record beside all of it"] = results.shorter
    said["no start"] = no_start.ranges(results.drawn, results.config.twin_tolerance)
    said["cost"] = {**dataclasses.asdict(results.cost), "seconds_alone": results.cost.seconds_alone}
    said["seconds"] = results.seconds
    return said


def write_report(results: Results, out: Path) -> None:
    """Draw the figures and write the page."""
    sections = [
        _step1(results, out),
        *(_step2(law, one, out) for law, one in results.laws.items()),
        *(_step3(law, one, out) for law, one in results.laws.items()),
        _mistakes(results, out),
        _no_start(results, out),
        _how(results),
    ]
    write_page(
        out / "report.html",
        "From which starts does each method end at the machine?",
        _SOURCE.format(noise=results.config.noise_N),
        _answer(results),
        sections,
        _footer(results, out),
    )


def _answer(results: Results) -> list[str]:
    law, one = next(iter(results.laws.items()))
    step1 = {m: rigid_start.ranges(lanes) for m, lanes in one.step1.items()}
    plain, safe = step1[DIDIM.name], step1[SAFE_DIDIM.name]
    middle, every, everywhere = plain["10 to 1000 kg"], plain["all starts"], safe["all starts"]
    assert isinstance(middle, Count) and isinstance(every, Count) and isinstance(everywhere, Count)
    lost = plain["unstable loop at the start"]
    assert isinstance(lost, Count)
    boxes = {m: mode_start.ranges(lanes)["the paper's box"] for m, lanes in one.step2.items()}
    step3 = {m: count(lanes) for m, lanes in one.step3.items()}
    none = no_start.ranges(results.drawn, results.config.twin_tolerance)
    low, high = results.config.rigid_mass_kg
    return [
        f"Step 1 ({law} law): from 10 to 1000 kg rigid DIDIM converges from {middle.truth} of {middle.lanes} starts, "
        f"in at most {middle.iterations_most} iterations. From {low:g} to {high:g} kg it is {_of(every)}; "
        f"{lost.lanes} of those starts make the loop itself unstable. With the safeguard: {_of(everywhere)}, "
        f"at most {everywhere.iterations_most} iterations.",
        "Step 2: inside the paper's box "
        + "; ".join(
            f"{m} finds the minimum from {_of(c)}{_median(c)}" for m, c in boxes.items() if isinstance(c, Count)
        )
        + ".",
        f"Step 3, M1, M2 and K12 each off by up to {100 * results.config.global_off:g} %: "
        + "; ".join(f"{m} {_of(c)}" for m, c in step3.items())
        + f". DIDIM counts as right within {100 * global_start.DIDIM_TOLERANCE:g} %, the exact methods within "
        f"{100 * global_start.TOLERANCE:g} %.",
        f"No start is needed: of {none['machines']} random machines, scan and exact method find {none['right']} "
        f"(M1, M2, K12 within {100 * results.config.twin_tolerance:g} %; largest error "
        f"{none['error_percent_most']:.2g} %), in {none['seconds_median']:.2f} s (median), "
        f"{none['seconds_most']:.2f} s (longest).",
    ]


def _of(c: Count) -> str:
    return f"{c.truth} of {c.lanes} ({c.percent:.1f} %)"


def _median(c: Count) -> str:
    return f", {c.iterations_median:.0f} iterations (median)" if c.truth else ""


def _rows(said: dict[str, object], method: str) -> list[list[str]]:
    rows = []
    for region, c in said.items():
        if isinstance(c, Count) and c.lanes:
            median = f"{c.iterations_median:.0f}" if c.truth else ""
            most = str(c.iterations_most) if c.truth else ""
            ends = [str(x) for x in (c.lanes, c.truth, c.elsewhere, c.diverged, c.exhausted)]
            rows.append([f"{method}: {region}", *ends, f"{c.percent:.1f}", median, most])
    return rows


_HEADER = (
    "method: starts",
    "starts",
    "truth",
    "elsewhere",
    "diverged",
    "exhausted",
    "truth, %",
    "iterations, median",
    "most",
)


def _table(by_method: dict[str, dict[str, object]], caption: str) -> Tabular:
    return Tabular(_HEADER, [row for method, said in by_method.items() for row in _rows(said, method)], caption)


def _step1(results: Results, out: Path) -> Section:
    figure = picture(
        figures.rigid_figure({law: one.step1 for law, one in results.laws.items()}),
        out / "figures" / "step1.png",
        "Iterations of rigid DIDIM from every mass. A cross at zero is a start whose first simulation is not finite.",
    )
    tables = [
        _table({m: rigid_start.ranges(lanes) for m, lanes in one.step1.items()}, f"Step 1, {law} law")
        for law, one in results.laws.items()
    ]
    words = Text(
        "The safeguard does two things. A step after which the simulation is not finite, or the criterion more than "
        "twice as large, is halved; it does not ask the criterion to fall, because DIDIM's fixed point is not its "
        "minimum and a search that asks for decrease stalls beside it. And a start whose own loop is unstable has no "
        "finite simulation at all: its mass is doubled until the loop is stable, which takes the controller's law and "
        "nothing of the machine. Such starts are hatched and counted apart. The paper reports 25 to 1000 kg."
    )
    return Section("Step 1: rigid DIDIM at 5 Hz", [words, figure, *tables])


def _step2(law: str, one: OneLaw, out: Path) -> Section:
    figure = picture(
        figures.mode_figure(one.step2, law),
        out / "figures" / f"step2_{law}.png",
        "Above: how each start ends. Below: iterations of those that find the minimum.",
    )
    minimum, true = one.minimum, one.true_mode
    words = Text(
        f"The criterion is least at lam = {minimum['lam']:.3f}, f_n = {minimum['f_n']:.2f} Hz, beside the true "
        f"{true[0]:.3f} and {true[1]:.2f} Hz: the maps use the record's beginning only, where step 2, which leaves all "
        "friction on the motor side (eq. 27), is drawn aside; on the whole record it is not (last section). That "
        f"minimum is 'the truth' here, within {100 * mode_start.TOLERANCE:g} %. "
        + (
            "Hatched: the sampled loop around the start is unstable."
            if law == "sampled"
            else "The continuous loop is stable everywhere; hatched is where its integration is not."
        )
    )
    table = _table({m: mode_start.ranges(lanes) for m, lanes in one.step2.items()}, f"Step 2, {law} law")
    return Section(f"Step 2: mass ratio and mode, {law} law", [words, figure, table])


def _step3(law: str, one: OneLaw, out: Path) -> Section:
    figure = picture(
        figures.global_figure(one.step3, law),
        out / "figures" / f"step3_{law}.png",
        "Draws over the errors of M2 and K12 (that of M1 is not shown), and the share that finds the truth.",
    )
    table = _table({m: global_start.ranges(lanes) for m, lanes in one.step3.items()}, f"Step 3, {law} law")
    words = Text(
        "Friction starts as step 1 has it, on the motor side. Levenberg-Marquardt begins damped (lambda = 1e5 N^2). "
        "DIDIM ends by eq. 21."
    )
    return Section(f"Step 3: all parameters, {law} law", [words, figure, table])


def _mistakes(results: Results, out: Path) -> Section:
    figure = picture(
        figures.condition_figure(results.conditions, results.labels),
        out / "figures" / "mistakes.png",
        f"A dot a record, a line through the medians; starts 5 % off. {DIDIM.name} and {EXACT.name}, sampled law.",
    )
    rows = [
        [
            f"{results.labels[name]} = {row['level']:g}, {method}",
            f"{row['converged']:.0f} of {row['lanes']:.0f}",
            f"{row['median_percent']:.3g}",
            f"{row['most_percent']:.3g}",
        ]
        for name, methods in results.conditions.items()
        for method, lanes in methods.items()
        for row in conditions.ranges(lanes)
    ]
    header = ("mistake and method", "converged", "error, median, %", "error, most, %")
    return Section("What else may be wrong", [figure, Tabular(header, rows, "Largest error of M1, M2, K12")])


def _no_start(results: Results, out: Path) -> Section:
    tolerance = results.config.twin_tolerance
    none = no_start.ranges(results.drawn, tolerance)
    figure = picture(
        figures.no_start_figure(results.drawn, tolerance),
        out / "figures" / "no_start.png",
        "lam 0.2 to 0.9, f_n 10 to 60 Hz, 60 to 200 kg, friction 50 to 400 N s/m and 5 to 40 N shared at random, noise "
        "0.5 to 5 N; trapezoids and chirps up to 110 Hz of random sizes, less where the drive's 10 V ask for it.",
    )
    words = Text(
        "Rigid DIDIM from the rough mass of machine.toml, a scan of 84 modes with its totals, then damped exact steps "
        "from the four best cells: six of them from each, up to ten more from the better two, then full steps from "
        "the best; the next four cells, twice, where that does not end, or ends with a friction that drives the "
        "machine. "
        f"{none['under_one_second']} of {none['machines']} machines take less than a second, once compiled; "
        f"the median takes {none['processor_seconds_median']:.2f} s of processor time, the longest "
        f"{none['processor_seconds_most']:.2f} s, over both cores and beside whatever else ran. Machines whose own "
        "sampled loop would be unstable are not drawn."
    )
    parts: list[Text | Tabular | Picture] = [words, figure]
    if wrong := [d for d in results.drawn if not d.error < tolerance]:
        rows = [
            [f"{d.lam:.2f}, {d.f_n_Hz:.1f} Hz, {d.true['M1'] + d.true['M2']:.0f} kg, x {d.amplitude:.2f}"]
            + [f"{100 * d.right[n]:+.1f}" for n in global_start.MASSES]
            + [f"{d.noise_N:.1f}", "yes" if d.converged else "no"]
            for d in wrong
        ]
        header = ("machine", "M1 off, %", "M2 off, %", "K12 off, %", "noise, N", "converged")
        parts.append(Tabular(header, rows, "Machines that were not found"))
    return Section("No start needed", parts)


def _how(results: Results) -> Section:
    c, config = results.cost, results.config
    integration = ", ".join(f"{100 * one.integration_error:.2g} % ({law})" for law, one in results.laws.items())
    text = (
        f"Lanes run batch by batch on {c.devices} devices. They integrate with Bosh3 instead of the record's Tsit5: "
        f"that changes the filtered force by {integration} of its norm. Steps 1 and 2 use the first "
        f"{config.map_seconds:g} s of the record, everything else all of it."
    )
    if results.shorter:
        s = results.shorter
        text += (
            f" Does that change the maps? Of {s['starts']:.0f} starts of step 2's map, run on both, "
            f"{s['agree_percent']:.0f} % end the same way ({s['truth_on_beginning']:.0f} find the minimum on the "
            f"beginning, {s['truth_on_full_record']:.0f} on all of it)."
        )
    cost = (
        f"{c.starts} starts times {c.iterations} iterations of Nelder-Mead on {c.samples} samples take "
        f"{c.seconds:.0f} s ({c.processor_seconds:.0f} s of processor time, {c.seconds_alone:.0f} s a core), load "
        f"average {c.load:.1f} meanwhile, batch {c.batch}."
    )
    rows = [[name, f"{s:.0f}"] for name, s in results.seconds.items()]
    return Section(
        "How, and what it costs",
        [Text(text), Text(cost), Tabular(("part", "s"), rows, "Time of this run; what an earlier one left takes none")],
    )


def _footer(results: Results, out: Path) -> str:
    provenance = json.loads((out / "run.json").read_text(encoding="utf-8"))
    packages = ", ".join(f"{k} {v}" for k, v in provenance["packages"].items())
    lanes = sum(d.sizes["lane"] for d in _every(results))
    return (
        f"{lanes} lanes. Commit {provenance['commit']}; {packages}. Arrays in maps/*.zarr, counts in ranges.json, the "
        "config as used in run.json."
    )


def _every(results: Results) -> list[xr.Dataset]:
    maps = [d for one in results.laws.values() for step in (one.step1, one.step2, one.step3) for d in step.values()]
    return maps + [d for methods in results.conditions.values() for d in methods.values()]
