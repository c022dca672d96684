"""Readouts: what is trained on the features."""

from collections.abc import Sequence

from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import StandardScaler

from labctl.analysis.softmax import TOLERANCE, SoftmaxRegression
from labctl.analysis.windows import WindowFeatures


def softmax_classifier(inverse_penalty: float = 1.0) -> Pipeline:
    """Multinomial logistic regression on standardised features: y = softmax(W x + b), penalty sum(W^2) / (2 C).

    The weaker the penalty, the smaller its gradient: the optimum is where that is balanced, not where it is forgotten.
    """
    tolerance = TOLERANCE / max(1.0, inverse_penalty)
    return make_pipeline(StandardScaler(), SoftmaxRegression(C=inverse_penalty, tol=tolerance))


def softmax_readout(
    *,
    ports: Sequence[int] | None,
    window_s: float,
    sample_interval_s: float,
    start_s: float = 0.0,
    tau_s: float | None = None,
    recorded_ports: Sequence[int] | None = None,
    inverse_penalty: float = 1.0,
) -> Pipeline:
    """`WindowFeatures` with these arguments, then `softmax_classifier`: records (shots, ports, samples) to classes."""
    features = WindowFeatures(
        ports=ports,
        window_s=window_s,
        sample_interval_s=sample_interval_s,
        start_s=start_s,
        tau_s=tau_s,
        recorded_ports=recorded_ports,
    )
    return Pipeline([("windowfeatures", features), *softmax_classifier(inverse_penalty).steps])
