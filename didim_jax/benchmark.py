"""The EMPS records through the official `nonlinear_benchmarks` package, which downloads and keeps them.

Reference: A. Janot, M. Gautier, M. Brunot, "Data Set and Reference Models of EMPS", Workshop on Nonlinear System
Identification Benchmarks, Eindhoven, 2019.
"""

import contextlib
import io
from pathlib import Path

from didim_jax.errors import InputError
from didim_jax.formats import load_recording
from didim_jax.recording import Recording


def load_emps_benchmark() -> tuple[Recording, Recording]:
    """DATA_EMPS (to fit) and DATA_EMPS_PULSES (to judge), from the package's own folder, downloaded at the first call.

    The package's arrays hold vir and qm only; the control loop needs qg, so the files it keeps are read instead.

    Raises InputError: package not installed, download failed, files missing or unreadable.
    """
    try:
        import nonlinear_benchmarks
    except ImportError as error:
        raise InputError(
            f"the EMPS benchmark needs the package nonlinear_benchmarks, which cannot be imported "
            f"({error}); install it, or give DATA_EMPS.mat as a file."
        ) from error
    try:
        with contextlib.redirect_stdout(io.StringIO()):  # the package prints its progress
            found = nonlinear_benchmarks.EMPS(data_file_locations=True)
    except Exception as error:  # network, drive quota, damaged archive: the package lets every kind through
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise InputError(
            f"the EMPS benchmark could not be downloaded ({reason}); try again later, or give DATA_EMPS.mat as a file."
        ) from error
    paths = [Path(path) for path in found]
    for path in paths:
        if not path.is_file():  # an interrupted download leaves a folder the package then takes for complete
            raise InputError(
                f"{path}: the download of the EMPS benchmark is incomplete; "
                f"remove the folder {path.parent} and try again."
            )
    fit, check = (load_recording(path) for path in paths)
    return fit, check
