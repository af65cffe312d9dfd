"""Learns the metrics of a map's channels from all its traverses."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from placefield.config import Config, MetricConfig
from placefield.maps.build_steps import Arrays, Share, Steps
from placefield.maps.gathering import centred, probes_of, trained_first
from placefield.metric.cross_validation import choose_push
from placefield.metric.gate import Probes
from placefield.metric.learn import LearnedMetric, held_back_frames, learn_projection

HELD_BACK = 0.2  # of the reference, as in the paper

Array = NDArray[np.float32]
Labels = NDArray[np.int32]


def held_back_places(count: int, seed: int) -> NDArray[np.bool_]:
    """Return which places are held back from learning a metric, (count,) bool."""
    return held_back_frames(count, HELD_BACK, seed)


@dataclass(frozen=True, eq=False)
class Training:
    """The frames of all traverses, as metrics are learned from them.

    Attributes:
        reference: (F, N) float32, their centred descriptors, those of held-back places last; (0, N)
            where nothing is learned.
        places: (F,) int32, the place that each of them shows.
        trained: how many of them a metric is learned from. It is validated by the others.
        probes: of the gate; None: there are none, as of one traverse.
    """

    reference: Array
    places: NDArray[np.int32]
    trained: int
    probes: Probes | None

    @classmethod
    def of(
        cls, descriptors: Sequence[Array], place_of: Sequence[NDArray[np.int32]], config: Config
    ) -> "Training":
        """Gather the frames of the traverses.

        Args:
            descriptors: of each traverse, (F, N) float32; the first's are the places.
            place_of: of each traverse, (F,) int32, the place that each of its frames shows.
            config: its metric and seed are used.
        """
        held_back = held_back_places(len(descriptors[0]), config.seed)
        probes = probes_of(descriptors, place_of, held_back)
        order, places = trained_first(held_back, place_of)
        if _learns_nothing(config.metric, probes):
            reference = descriptors[0][:0]  # of many places a copy is large
        else:
            reference = centred(descriptors, order)
        return cls(reference, places, len(places) - int(held_back[places].sum()), probes)

    def labels_of(self, labels: Labels) -> Labels:
        """Return the label of each frame, given that of each place, (K,) int32."""
        return labels[self.places]


def _learns_nothing(config: MetricConfig, probes: Probes | None) -> bool:
    """Whether no metric can be learned, whatever the frames are."""
    return config.kind == "identity" or (config.gate and probes is None)


def with_push(config: Config, training: Training, labels: Labels) -> Config:
    """Return the settings with the metric's push as a number, the same for all channels.

    Where push is to be chosen, cross-validation chooses it.

    Args:
        config: its metric and seed are used.
        training: the frames.
        labels: (K,) int32, the segment of each place in the first channel.
    """
    metric = config.metric
    if not isinstance(metric.push, str):
        return config
    if metric.kind != "lmnn" or (metric.gate and training.probes is None):
        push = MetricConfig().push
    else:
        of_frames = training.labels_of(labels)
        push = choose_push(training.reference, of_frames, training.places, metric, config.seed)
    return config.model_copy(update={"metric": metric.model_copy(update={"push": push})})


def learn_metric(
    number: int, labels: Labels, training: Training, config: Config, steps: Steps
) -> LearnedMetric:
    """Learn the metric of a channel.

    Args:
        number: of the channel.
        labels: (K,) int32, the segment of each place in it.
        training: the frames.
        config: its metric, with a number as push, and its seed are used.
        steps: how it is carried out.
    """
    share = steps.share(number, "learning")
    share(0)

    def learned() -> Arrays:
        return _learned(training.labels_of(labels), training, config, share).arrays()

    metric = LearnedMetric.of(*steps.finish(f"channel-{number}-metric", learned))
    share(1)
    return metric


def _learned(labels: Labels, training: Training, config: Config, share: Share) -> LearnedMetric:
    """Learn a metric from the label of each frame of the training."""
    metric, reference = config.metric, training.reference
    if metric.kind == "identity":
        identity = np.eye(reference.shape[1], dtype=np.float32)
        return LearnedMetric(identity, "none was asked for", np.empty((0, 2)))
    return learn_projection(
        reference,
        labels,
        training.trained,
        training.probes,
        metric,
        config.seed,
        on_step=lambda step, *_: share(step / metric.steps),
    )
