"""FAB-MAP 1.0: recognises places by their visual words (Cummins and Newman, IJRR 2008)."""

from placefield.baselines.fabmap.chow_liu import ChowLiuTree, learn_tree
from placefield.baselines.fabmap.posterior import FabMap, fabmap
from placefield.baselines.fabmap.words import Vocabulary, learn_words

__all__ = ["ChowLiuTree", "FabMap", "Vocabulary", "fabmap", "learn_tree", "learn_words"]
