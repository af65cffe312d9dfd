"""Maps: building, saving, opening and transferring them."""
