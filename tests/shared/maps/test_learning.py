import pytest

from placefield.maps.learning import held_back_places


@pytest.mark.parametrize("count", [15, 300])
def test_a_fifth_of_the_places_is_held_back(count: int) -> None:
    assert held_back_places(count, seed=1).sum() == count / 5
