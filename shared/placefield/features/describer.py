"""A transformer for scikit-learn's pipelines that turns images into descriptors."""

from collections.abc import Iterable
from typing import Self

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.utils.validation import check_is_fitted

from placefield.features.extract import default_dimensions, feature_of
from placefield.features.images import Image, load
from placefield.features.joined_model import AnyModel, fit_parts

Array = NDArray[np.float32]


class Describer(TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """Fits a descriptor model on the images of a traverse, as ``build_map`` does.

    Descriptors are standardised by the mean and deviation of that traverse. A ``Recognizer`` is
    different: it standardises a query by the query's own running mean and deviation.

    Attributes:
        model_: the descriptor model, after ``fit``.
    """

    model_: AnyModel

    def __init__(self, kind: str = "gist", dimensions: int | None = None) -> None:
        """Set the feature (grayscale, gist, onnx:FILE, or several joined by a plus sign).

        ``dimensions`` is the most that PCA keeps of each.
        """
        self.kind = kind
        self.dimensions = dimensions

    def fit(self, images: Iterable[Image], y: None = None) -> Self:
        """Fit the model on images: encoded, pixels (H, W) or (H, W, 3) BGR uint8, or files.

        Raises:
            FrameError: an image does not decode.
            SourceError: a file cannot be read.
        """
        feature = feature_of(self.kind)
        self.model_, _ = fit_parts(
            [np.stack([feature.describe(load(image)) for image in images])],
            feature.parts,
            dimensions=[self.dimensions or default_dimensions(part.kind) for part in feature.parts],
            standardise=True,
            plain=False,
        )
        return self

    def transform(self, images: Iterable[Image]) -> Array:
        """Return the descriptors of images, (K, N) float32, of unit length.

        Raises:
            FrameError: an image does not decode.
            SourceError: a file cannot be read.
        """
        check_is_fitted(self)
        feature = feature_of(self.kind)
        raw = np.stack([feature.describe(load(image)) for image in images])
        return self.model_.of_reference(raw)
