import doctest

from caesura_protocol import number_words


def test_the_examples_hold():
    assert doctest.testmod(number_words).failed == 0
