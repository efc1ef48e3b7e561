"""The noise of a residual: an autoregressive model that whitens it, estimated from the residual itself."""

import dataclasses

import numpy as np
import scipy.linalg
import scipy.signal


@dataclasses.dataclass(frozen=True)
class Whitening:
    """e[k] = (r[k] + a_1 r[k-1] + ... + a_p r[k-p]) / sigma: innovations of unit variance."""

    a: np.ndarray
    sigma: float

    def __call__(self, r: np.ndarray) -> np.ndarray:
        """Along the last axis; before the first sample the residual was as then."""
        zi = scipy.signal.lfilter_zi(self.a, [1.0])
        return scipy.signal.lfilter(self.a, [1.0], r, axis=-1) / self.sigma if zi.size == 0 else self._settled(r)

    def _settled(self, r: np.ndarray) -> np.ndarray:
        padded = np.concatenate([np.zeros((*r.shape[:-1], len(self.a) - 1)), r], axis=-1)
        return scipy.signal.lfilter(self.a, [1.0], padded, axis=-1)[..., len(self.a) - 1 :] / self.sigma


def autoregressive(r: np.ndarray, order: int = 10, least: float = 0.0) -> Whitening:
    """Yule-Walker on the biased autocovariance of r, (n,); `least` is the smallest rms of the innovations."""
    r = r - 0.0
    n = len(r)
    c = np.array([r[: n - k] @ r[k:] / n for k in range(order + 1)])
    c[0] *= 1 + 1e-6  # a residual that is nothing but smooth has no unpredictable part
    a = scipy.linalg.solve_toeplitz(c[:order], -c[1:]) if order else np.zeros(0)
    sigma = float(np.sqrt(max(c[0] + a @ c[1:], 0.0)))
    return Whitening(np.concatenate([[1.0], a]), max(sigma, least, 1e-300))
