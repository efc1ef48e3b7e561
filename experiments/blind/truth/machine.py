"""A machine drawn at random around an EMPS-like axis: base parameters, controller, drive, encoder."""

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from .slots import slots

DT = 1e-3  # s, controller sample
LIMIT = 10.0  # V
RESOLUTION = 5e-8  # m per count
LEAST_DAMPING = 0.08  # damping ratio that every oscillating mode of the closed loop keeps


@dataclass(frozen=True)
class Machine:
    """What is drawn once and holds for both records. SI units, load axis."""

    model: str
    base: dict[str, float]  # M1, Fv1, Fc1, M2, Fv2, Fc2, K12, C12; or M, Fv, Fc
    gain: float  # N/V
    kp: float  # 1/s
    kv: float  # V s/m
    lead: float  # m per motor turn
    mass_apriori: float  # kg
    round_counts: bool

    @property
    def rigid(self) -> bool:
        return self.model == "rigid"

    @property
    def mass(self) -> float:
        """Total, kg."""
        return self.base["M"] if self.rigid else self.base["M1"] + self.base["M2"]

    @property
    def coulomb(self) -> float:
        """Total, N."""
        return self.base["Fc"] if self.rigid else self.base["Fc1"] + self.base["Fc2"]

    def slots(self) -> np.ndarray:
        """The nominal machine as the kernel reads it."""
        base = self.base
        if self.rigid:
            base = {"M1": base["M"], "Fv1": base["Fv"], "Fc1": base["Fc"], "rigid": 1.0}
        return slots(
            **base,
            dt=DT,
            g=self.gain,
            kp=self.kp,
            kv=self.kv,
            limit=LIMIT,
            lead=self.lead,
            resolution=RESOLUTION,
            encoder_law=float(self.round_counts),
        )

    def toml(self, name: str, load_encoder: bool) -> str:
        """The text of machine.toml: what is known beforehand."""
        measured = "motor and load position" if load_encoder else "motor position"
        lines = (
            (f'name = "{name}"', ""),
            (f'model = "{self.model}"', 'the nominal plant: "rigid" or "flexible"'),
            (f"mass_apriori = {self.mass_apriori}", "kg, total, rough"),
            (f"screw_lead = {self.lead}", "m per motor turn"),
            ("[controller]", "vir = kv * (kp * (qg - qm) - dq), held between samples"),
            ('law = "pd"', ""),
            (f"kp = {self.kp}", "1/s"),
            (f"kv = {self.kv}", "V s/m"),
            (f"sample_time = {DT}", "s"),
            ('velocity = "two-sample"', "dq[k] = (qm[k] - qm[k-2]) / (2 * sample_time)"),
            ("[drive]", ""),
            (f"gain = {self.gain}", "N/V"),
            (f"limit = {LIMIT}", "V"),
            ("[encoder]", ""),
            (f"resolution = {RESOLUTION}", "m per count"),
        )
        body = "\n".join(f"{entry:<34}# {comment}" if comment else entry for entry, comment in lines)
        return f"# What is known of the machine before looking at its data: {measured}. SI units, load axis.\n{body}\n"


def draw_machine(rng: np.random.Generator, model: str) -> Machine:
    """Masses 70-140 kg, mode 15-35 Hz with the motor locked, and gains under which the closed loop is well damped."""
    while True:
        mass = rng.uniform(70, 140)
        lam = rng.uniform(0.4, 0.8)
        mode = rng.uniform(15, 35)
        Fv, Fc = rng.uniform(120, 300), rng.uniform(10, 30)
        share_v, share_c = rng.uniform(0.3, 0.7, 2)
        if model == "rigid":
            base = {"M": mass, "Fv": Fv, "Fc": Fc}
        else:
            M2 = (1 - lam) * mass
            base = {
                "M1": lam * mass,
                "Fv1": share_v * Fv,
                "Fc1": share_c * Fc,
                "M2": M2,
                "Fv2": (1 - share_v) * Fv,
                "Fc2": (1 - share_c) * Fc,
                "K12": M2 * (2 * np.pi * mode) ** 2,
                "C12": rng.uniform(15, 45),
            }
        machine = Machine(
            model=model,
            base={name: float(value) for name, value in base.items()},
            gain=round(float(rng.uniform(28, 42)), 2),
            kp=round(float(rng.uniform(100, 165)), 2),
            kv=round(float(rng.uniform(210, 290)), 2),
            lead=float(rng.choice([0.002, 0.0025, 0.004, 0.005])),
            mass_apriori=float(round(mass * rng.uniform(0.8, 1.2))),
            round_counts=bool(rng.random() < 0.5),
        )
        if least_damping(machine) > LEAST_DAMPING:
            return machine


def least_damping(machine: Machine) -> float:
    """Smallest damping ratio of the sampled closed loop, friction viscous only."""
    b, G = machine.base, machine.gain
    if machine.rigid:
        A = np.array([[0, 1], [0, -b["Fv"] / b["M"]]])
        B = np.array([0, G / b["M"]])
    else:
        K, C = b["K12"], b["C12"]
        A = np.array(
            [
                [0, 1, 0, 0],
                [-K / b["M1"], -(C + b["Fv1"]) / b["M1"], K / b["M1"], C / b["M1"]],
                [0, 0, 0, 1],
                [K / b["M2"], C / b["M2"], -K / b["M2"], -(C + b["Fv2"]) / b["M2"]],
            ]
        )
        B = np.array([0, G / b["M1"], 0, 0])
    n = len(B)
    held = linalg.expm(np.block([[A, B[:, None]], [np.zeros((1, n + 1))]]) * DT)
    # state, and the two readings before
    loop = np.zeros((n + 2, n + 2))
    law = np.zeros(n + 2)
    law[0] = -machine.kv * (machine.kp + 1 / (2 * DT))
    law[n + 1] = machine.kv / (2 * DT)
    loop[:n, :n] = held[:n, :n]
    loop[:n] += np.outer(held[:n, n], law)
    loop[n, 0] = loop[n + 1, n] = 1
    roots = np.linalg.eigvals(loop)
    roots = roots[np.abs(roots) > 1e-3]
    s = np.log(roots.astype(complex)) / DT
    return float(np.min(-s.real / np.abs(s)))
