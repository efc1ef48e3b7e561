"""The real EMPS records: IDIM-LS, DIDIM and exact Gauss-Newton, symmetric and asymmetric friction, beside the authors'.

python -m experiments.emps [--config configs/emps.toml] [--set key=value ...] [--quick] --out DIR
"""

from pathlib import Path
from typing import Literal

from matplotlib.figure import Figure
from pydantic import Field
from pydantic.dataclasses import dataclass

from didim_jax import InputError, Machine, load_recording
from didim_jax.config import CONFIG
from didim_jax.identify import Choices, Method, Study, identify
from didim_jax.report.canvas import FAINT, RESIDUAL, SIMULATED, THIRD, canvas, label, title
from didim_jax.report.figures import force_figure

from .data import EMPS_MACHINE, emps_folder
from .page import Section, Tabular, Text, picture, write_page
from .study import main, write_json

AUTHORS = {
    "symmetric": {
        "M": (95.1089, 0.1085),
        "Fv": (203.5034, 1.1460),
        "Fc": (20.3935, 0.1012),
        "offset": (-3.1648, 0.0444),
    },
    "asymmetric": {
        "M": (95.1540, 0.0827),
        "Fv_pos": (166.7061, 1.2326),
        "Fc_pos": (20.1440, 0.1088),
        "Fv_neg": (240.4236, 1.2346),
        "Fc_neg": (20.6277, 0.1091),
    },
}
"""Values and standard deviations of the benchmark's authors, IDIM-LS (Janot, Gautier, Brunot, 2019)."""

AUTHORS_FORCE_ERROR = {"fit": 0.05848, "check": 0.089409}
"""Force error of the authors' own closed-loop simulation with their symmetric values, from rest and unfiltered."""


type Studies = dict[tuple[str, str], Study]
"""(friction, method) to what it gave."""


@dataclass(frozen=True, config=CONFIG)
class EmpsConfig:
    """What the study leaves open."""

    didim_hz: float = Field(gt=0, description="Hz")
    exact_hz: float = Field(gt=0, description="Hz")
    methods: list[Literal["idim-ls", "didim", "gauss-newton"]] = Field(min_length=1, description="methods to run")


def run(config: EmpsConfig, out: Path) -> None:
    """Identify with every method and both friction laws, and write tables.json, figures and report.html."""
    folder = emps_folder()
    if folder is None:
        raise InputError(
            "the EMPS records are not here: put DATA_EMPS.mat, DATA_EMPS_PULSES.mat and machine.toml in a folder emps "
            "and name the folder above it in DIDIM_DATA."
        )
    machine = Machine.load(EMPS_MACHINE)
    fit, check = (load_recording(folder / name) for name in ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat"))
    band = {Method.DIDIM: config.didim_hz, Method.GAUSS_NEWTON: config.exact_hz}
    studies: Studies = {
        (friction, method): identify(
            [fit],
            machine,
            Choices("rigid", Method(method), friction == "asymmetric", cutoff_hz=band.get(Method(method))),
            check,
        )
        for friction in AUTHORS
        for method in config.methods
    }
    write_json(out / "tables.json", rows(studies))
    best = min(studies.values(), key=lambda study: study.runs[0].force_error)  # chosen on the fit record alone
    assert best.check is not None
    pictures = [
        picture(_errors(studies), out / "figures" / "errors.png", "Closed-loop force error below 60 Hz, every sample."),
        picture(
            force_figure(best.runs[0], "fit"),
            out / "figures" / "force_fit.png",
            f"Measured and simulated force on the record of the fit: {best.result.method}, asymmetric friction.",
        ),
        picture(
            force_figure(best.check, "check"),
            out / "figures" / "force_check.png",
            "The same drive on the other record.",
        ),
    ]
    write_page(
        out / "report.html",
        "EMPS: the benchmark's records, identified",
        "Measured data: DATA_EMPS (fit) and DATA_EMPS_PULSES (check) of the public EMPS benchmark; none synthetic.",
        answer(studies),
        [
            Section("Parameters", [_parameter_table(studies, friction) for friction in AUTHORS]),
            Section(
                "Closed-loop simulation",
                [
                    _error_table(studies),
                    Text(
                        "Force error: norm of the residual over norm of the measured force, both below 60 Hz, every "
                        "sample counted, the initial state of each record estimated. The authors' figures are theirs, "
                        "unfiltered and from rest."
                    ),
                    *pictures,
                ],
            ),
            Section("What was odd in the records", [Text(f"{name}: {f.message}") for name, f in best.findings]),
        ],
        "Run folder: run.json holds configuration, package versions and commit; tables.json every number.",
    )


def rows(studies: Studies) -> list[dict[str, object]]:
    """One row for each friction law, method and parameter, then the errors."""
    table: list[dict[str, object]] = []
    for (friction, method), study in studies.items():
        r = study.result
        for name, unit, value, std, wide in zip(r.names, r.units, r.theta, r.std, r.std_autocorrelated, strict=True):
            authors = AUTHORS[friction].get(name, (None, None))
            table.append(
                {
                    "friction": friction,
                    "method": method,
                    "parameter": name,
                    "ours": value,
                    "std": std,
                    "std_autocorrelated": wide,
                    "authors": authors[0],
                    "authors_std": authors[1],
                    "unit": unit,
                }
            )
        assert study.check is not None
        for where, error in (("fit", study.runs[0].force_error), ("check", study.check.force_error)):
            table.append(
                {
                    "friction": friction,
                    "method": method,
                    "parameter": f"force error, {where}",
                    "ours": error,
                    "authors": AUTHORS_FORCE_ERROR[where] if friction == "symmetric" else None,
                    "unit": "1",
                }
            )
    return table


def answer(studies: Studies) -> list[str]:
    """The result in words, from the numbers."""
    said = []
    for friction in AUTHORS:
        best = min((s for (f, _), s in studies.items() if f == friction), key=lambda s: s.runs[0].force_error)
        assert best.check is not None
        values = ", ".join(
            f"{n} = {v:.4g} ± {s:.1g} {u}"
            for n, v, s, u in zip(
                best.result.names, best.result.theta, best.result.std_autocorrelated, best.result.units, strict=True
            )
        )
        said.append(
            f"With {friction} friction, {best.result.method} gives {values}; the simulated loop leaves "
            f"{100 * best.runs[0].force_error:.2f} % of the motor force on the record of the fit and "
            f"{100 * best.check.force_error:.2f} % on the other one."
        )
    return said


def _parameter_table(studies: Studies, friction: str) -> Tabular:
    chosen = {method: s for (f, method), s in studies.items() if f == friction}
    header = ["parameter", "authors (IDIM-LS)", *(s.result.method for s in chosen.values())]
    body = []
    for name, (value, std) in AUTHORS[friction].items():
        ours = [
            f"{s.result[name]:.4f} ± {s.result.std[s.result.names.index(name)]:.4f} "
            f"({100 * (s.result[name] / value - 1):+.2f} %)"
            for s in chosen.values()
        ]
        body.append([name, f"{value} ± {std}", *ours])
    return Tabular(header, body, f"{friction} friction; ± is the standard deviation of eq. 13-14")


def _error_table(studies: Studies) -> Tabular:
    body = [
        [
            "authors' own simulation (from rest, unfiltered, unit delay)",
            *(f"{100 * e:.2f} %" for e in AUTHORS_FORCE_ERROR.values()),
        ]
    ]
    for (friction, _), study in studies.items():
        assert study.check is not None
        errors = (study.runs[0].force_error, study.check.force_error)
        body.append([f"{study.result.method}, {friction}", *(f"{100 * e:.2f} %" for e in errors)])
    return Tabular(["", "DATA_EMPS (fit)", "DATA_EMPS_PULSES (check)"], body, "Closed-loop force error")


def _errors(studies: Studies) -> Figure:
    figure, axes = canvas(8.5, 3.2, 1, 1, margins=(2.4, 0.3, 0.6, 0.4))
    ax = axes[0, 0]
    names = ["authors' own (from rest, unfiltered)", *(f"{s.result.method}, {f}" for (f, _), s in studies.items())]
    errors = [tuple(AUTHORS_FORCE_ERROR.values())]
    errors += [(s.runs[0].force_error, s.check.force_error) for s in studies.values() if s.check is not None]
    for k, (here, there) in enumerate(errors):
        ax.plot([100 * here, 100 * there], [k, k], color=FAINT, zorder=1)
        ax.scatter(100 * here, k, color=SIMULATED if k else THIRD, label="DATA_EMPS (fit)" if k == 1 else None)
        ax.scatter(
            100 * there, k, color=RESIDUAL if k else THIRD, marker="s", label="PULSES (check)" if k == 1 else None
        )
    ax.set_yticks(range(len(names)), names)
    ax.invert_yaxis()
    ax.set_xlim(left=0)
    ax.legend(frameon=False, fontsize=8.5, loc="lower right")
    label(ax, x="closed-loop force error, % of the measured force")
    title(ax, "How well each identified drive simulates the motor force (measured data)")
    return figure


if __name__ == "__main__":
    main("emps", EmpsConfig, run)
