"""A readout made of light: weights as attenuations in front of a balanced pair of detectors, and an integrator.

The outlook of the paper: instead of recording every port, each port's light is weighted in time by attenuators and
summed on detectors, so that one number a class and picture is left to be read. Source: Duport et al., Sci. Rep. 6,
22381 (2016), an analogue readout of modulator, balanced photodiodes and RC integrator.
"""

from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize
from scipy.special import log_softmax, softmax
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.linear_model import LogisticRegression
from sklearn.preprocessing import StandardScaler
from sklearn.utils.validation import check_is_fitted, validate_data

from labctl.errors import AnalysisError

CLIPS = (1.0, 0.7, 0.5, 0.35)
"""Parts of the largest weight that become full transmission; what is larger is cut to it."""
LEAST_GAIN = 1e-9
"""A move must lower the loss by more than its sum is exact."""


class AnalogueReadout(ClassifierMixin, BaseEstimator):  # type: ignore[misc]  # scikit-learn ships no types
    """Softmax readout whose weights are pairs of attenuations with few levels, trained as such.

    For each class the light of all ports is split evenly between two arms. In each arm an attenuator a port and sample
    lets through a(j) = e + (1 - e) j / (2^bits - 1), j = 0..2^bits - 1, with e the extinction. Crosstalk blurs the
    attenuations t = (1 - c n) a + c sum(a of the n neighbours): the ports on either side, and the sample before, whose
    setting a modulator has not quite left. A pair of detectors subtracts the arms, and a leaky integrator sums over the
    window: y = g sum_f leak_f (t+_f - t-_f) x_f + b, with an electronic gain g and threshold b a class; the largest y
    wins.

    Training rounds the best weights without levels, then moves one setting after the other to the level nearest to its
    best value where that lowers the loss (softmax with penalty, as `softmax_classifier`), gains and thresholds in
    between, until none moves: its loss cannot end above that of rounding.

    Features are light, port by port: shots x (ports x samples), in any unit.

    Args:
        ports: M, how many ports the features come from.
        bits: Of an attenuator.
        extinction_db: Least transmission of an attenuator below its largest, dB.
        crosstalk: c, part of each neighbour's setting that an attenuation takes over.
        time_constant: Of the integrator, in samples; infinite: it does not leak.
        photons: Mean number of photons that a feature of 1 stands for, at the port, for all classes together. Features
            are then noise-free light: training counts each by an arm in which its attenuator alone is open, prediction
            by the pairs. None: features are taken as they are.
        sweeps: How often training goes over all settings at most; 0: the best weights are only rounded.
        seed: Of the photons.

    Attributes:
        classes_: (K,) labels.
        settings_: (K, features) levels, above zero in the arm that adds, below in the one that subtracts.
        gain_: (K,) g.
        threshold_: (K,) b.
    """

    def __init__(
        self,
        ports: int = 1,
        bits: int = 4,
        *,
        extinction_db: float = 20.0,
        crosstalk: float = 0.02,
        time_constant: float = 25.0,
        photons: float | None = None,
        sweeps: int = 10,
        seed: int = 0,
    ) -> None:
        self.ports = ports
        self.bits = bits
        self.extinction_db = extinction_db
        self.crosstalk = crosstalk
        self.time_constant = time_constant
        self.photons = photons
        self.sweeps = sweeps
        self.seed = seed

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:  # noqa: N803  # scikit-learn's own name
        """Train on features (shots, ports x samples) of the classes `y`.

        Raises:
            AnalysisError: A setting that no such readout can have, features of another number of ports, or one class.
        """
        features, labels = validate_data(self, X, y, dtype=np.float64)
        self._check_settings()
        self._check_light(features)
        self.classes_, member = np.unique(labels, return_inverse=True)
        if self.classes_.size < 2:
            raise AnalysisError("all shots to train on are of one class: acquire more images")
        if self.photons is not None:
            share = self._share(self.photons)
            features = np.random.default_rng((self.seed, 0)).poisson(features * share) / share
        highest = 2**self.bits - 1
        seen = features * self._leak() @ self._mixing()
        training = _Training(seen, np.eye(self.classes_.size)[member], float(self._weight(1)))
        training.round(highest)
        for _ in range(self.sweeps):
            training.adjust()
            if not training.sweep(highest):
                break
        self.settings_, self.gain_, self.threshold_ = training.settings, training.gain, training.threshold
        return self

    def decision_function(self, X: ArrayLike) -> NDArray[np.float64]:  # noqa: N803
        """Value y of each class, (shots, K); with `photons`, of one measurement of each shot."""
        check_is_fitted(self)
        light = validate_data(self, X, dtype=np.float64, reset=False)
        self._check_light(light)
        difference = self._difference(light) if self.photons is None else self._counted(light, self.photons)
        return np.asarray(self.gain_ * difference + self.threshold_)

    def predict(self, X: ArrayLike) -> NDArray[np.generic]:  # noqa: N803
        """The class of each shot."""
        return np.asarray(self.classes_[self.decision_function(X).argmax(axis=1)])

    def attenuations(self) -> NDArray[np.float64]:
        """What each arm lets through, crosstalk included: (2, K, features), the adding arm first."""
        check_is_fitted(self)
        floor = 10 ** (-self.extinction_db / 10)
        arms = np.stack([np.maximum(self.settings_, 0), np.maximum(-self.settings_, 0)])
        return np.asarray((floor + self._weight(arms)) @ self._mixing().T)

    def _difference(self, light: NDArray[np.float64]) -> NDArray[np.float64]:
        """What the pairs integrate, adding less subtracting arm, (shots, K), in the unit of the features."""
        adding, subtracting = self.attenuations()
        return np.asarray(light * self._leak() @ (adding - subtracting).T)

    def _counted(self, light: NDArray[np.float64], photons: float) -> NDArray[np.float64]:
        """The same where each arm of each pair counts the photons of its share of the light."""
        generator = np.random.default_rng((self.seed, 1))
        share = self._share(photons)
        adding, subtracting = (
            np.stack([generator.poisson(share * light * arm) @ self._leak() for arm in arms], axis=1)
            for arms in self.attenuations()
        )
        return np.asarray((adding - subtracting) / share)

    def _share(self, photons: float) -> float:
        """Photons of an arm: the light of a port is split among the arms of all pairs."""
        return photons / (2 * self.classes_.size)

    def _weight(self, settings: ArrayLike) -> NDArray[np.float64]:
        """Transmission above the extinction at some settings, of either sign."""
        floor = 10 ** (-self.extinction_db / 10)
        return np.asarray((1 - floor) * np.asarray(settings) / (2**self.bits - 1))

    def _leak(self) -> NDArray[np.float64]:
        """What is left at the end of the window of each feature's charge, (features,)."""
        samples = self.n_features_in_ // self.ports
        return np.tile(np.exp((np.arange(samples) + 1 - samples) / self.time_constant), self.ports)

    def _mixing(self) -> NDArray[np.float64]:
        """What the settings (columns) make of the attenuations (rows), (features, features)."""
        samples = self.n_features_in_ // self.ports
        beside = np.eye(self.ports, k=1) + np.eye(self.ports, k=-1)
        neighbours = np.kron(beside, np.eye(samples)) + np.kron(np.eye(self.ports), np.eye(samples, k=-1))
        own = 1 - self.crosstalk * neighbours.sum(axis=1)
        return np.asarray(np.diag(own) + self.crosstalk * neighbours)

    def _check_settings(self) -> None:
        if self.ports < 1 or self.n_features_in_ % self.ports:
            raise AnalysisError(
                f"{self.n_features_in_} features are not equally many samples on {self.ports} ports: give ports as "
                "they were recorded"
            )
        if self.bits < 1 or not 0 <= self.crosstalk <= 1 / 3 or self.time_constant <= 0 or self.extinction_db <= 0:
            raise AnalysisError(
                f"no readout has {self.bits} bits, {self.extinction_db:g} dB of extinction, a crosstalk of "
                f"{self.crosstalk:g} and a time constant of {self.time_constant:g} samples: give at least one bit, a "
                "crosstalk of 0 to 1/3, and the others above zero"
            )

    def _check_light(self, light: NDArray[np.float64]) -> None:
        if self.photons is not None and (self.photons <= 0 or light.min() < 0):
            raise AnalysisError("photons cannot be counted of less than no light: cut the features at zero")


class _Training:
    """Settings, gains and thresholds that lower the loss sum(-log softmax(y)) + sum((g w sd)^2) / 2.

    On standardised features u, y = g_k sum_f (settings_kf width_f u_f) + bias_k: a level of f is worth `width_f`.
    """

    def __init__(self, seen: NDArray[np.float64], targets: NDArray[np.float64], level: float) -> None:
        """`seen`: (n, F) light as an arm's settings meet it. `targets`: (n, K), 1 for the class."""
        scaler = StandardScaler().fit(seen)
        self._standard = np.ascontiguousarray(scaler.transform(seen).T)
        self._middle = scaler.mean_ * level
        self._width = scaler.scale_ * level
        self._targets = np.ascontiguousarray(targets.T)
        self._bias = np.zeros(targets.shape[1])
        self.gain = np.ones(targets.shape[1])
        self.settings = np.zeros((targets.shape[1], seen.shape[1]), np.int64)

    @property
    def threshold(self) -> NDArray[np.float64]:
        """Threshold b of each class, for light that is not standardised."""
        return np.asarray(self._bias - self.gain * (self.settings @ self._middle))

    def round(self, highest: int) -> None:
        """The best weights without levels, rounded; of `CLIPS` the one that leaves the least loss."""
        model = LogisticRegression(max_iter=1000).fit(self._standard.T, self._targets.argmax(axis=0))
        weights, self._bias = model.coef_, model.intercept_
        if len(weights) == 1:  # of two classes scikit-learn gives the difference
            weights, self._bias = (np.concatenate([-half, half]) for half in (weights / 2, self._bias / 2))
        weights = weights / self._width
        tried = []
        for clip in CLIPS:
            self.gain = clip * np.abs(weights).max(axis=1).clip(np.finfo(float).tiny) / highest
            self.settings = np.rint(weights / self.gain[:, np.newaxis]).clip(-highest, highest).astype(np.int64)
            signals, sizes = self._signals()
            tried.append(
                (
                    _loss(signals + self._bias[:, np.newaxis], self._targets, float(sizes.sum())),
                    self.gain,
                    self.settings,
                )
            )
        _, self.gain, self.settings = min(tried, key=lambda found: found[0])

    def adjust(self) -> None:
        """The best gains and thresholds for the settings as they are."""
        signals, sizes = self._signals()
        classes = len(signals)

        def loss_and_slope(at: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
            factor, bias = at[:classes, np.newaxis], at[classes:, np.newaxis]
            scores = factor * signals + bias
            off = softmax(scores, axis=0) - self._targets
            slope = np.concatenate([np.sum(off * signals, axis=1) + factor[:, 0] * sizes, off.sum(axis=1)])
            return _loss(scores, self._targets, float(factor[:, 0] ** 2 @ sizes)), slope

        start = np.concatenate([np.ones(classes), self._bias])
        found = minimize(loss_and_slope, start, jac=True, method="L-BFGS-B").x
        self.gain, self._bias = self.gain * found[:classes], found[classes:]

    def sweep(self, highest: int) -> bool:
        """Try to move each setting to the level nearest to its best value; whether any moved.

        The best value is that of the parabola through the loss; a move that does not lower the loss itself is left.
        """
        scores = self._signals()[0] + self._bias[:, np.newaxis]
        parts = np.exp(scores - scores.max(axis=0))
        total, moved = parts.sum(axis=0), False
        for part, target, gain, settings in zip(parts, self._targets, self.gain, self.settings, strict=True):
            for feature, standard in enumerate(self._standard):
                step = gain * self._width[feature]
                change, size, old = step * standard, step * step, settings[feature]
                share = part / total
                slope = change @ (share - target) + size * old
                bend = change * change @ (share * (1 - share)) + size
                new = int(np.clip(np.rint(old - slope / bend), -highest, highest)) if bend > 0 else old
                if new == old:
                    continue
                factor = np.exp((new - old) * change)
                after = total + part * (factor - 1)
                loss = np.log(after / total).sum() - (new - old) * (change @ target) + size * (new**2 - old**2) / 2
                if loss < -LEAST_GAIN:
                    settings[feature], moved = new, True
                    part *= factor
                    total = after
        return moved

    def _signals(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Each y without its threshold, (K, n), and the penalty of each class times 2, (K,)."""
        weights = self.gain[:, np.newaxis] * self.settings * self._width
        return weights @ self._standard, np.sum(weights**2, axis=1)


def _loss(scores: NDArray[np.float64], targets: NDArray[np.float64], size: float) -> float:
    return float(size / 2 - np.sum(log_softmax(scores, axis=0) * targets))
