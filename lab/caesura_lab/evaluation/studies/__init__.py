"""Studies behind single figures: noise of a hand, motion libraries, realism, and density of the truth."""
