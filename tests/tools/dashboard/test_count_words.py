from placefield_tools.dashboard.count_words import MEANINGS, glossary


def test_a_glossary_has_the_counts_in_order_and_none_that_an_untrusted_client_made_up() -> None:
    found = glossary({"late", "<b>", "blank"})
    assert list(found.items()) == [(name, MEANINGS[name]) for name in ("blank", "late")]
