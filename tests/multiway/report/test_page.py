"""The report of many scans: each has a colour of its own."""

from dqreg.multiway.report.page import colours_of
from dqreg.report.figure import PALETTE


def test_each_scan_has_a_colour_of_its_own() -> None:
    for count in (0, 3, 24, 100):
        found = colours_of(count)
        assert len(found) == len(set(found)) == count
        assert found[: len(PALETTE)] == list(PALETTE[:count])
        assert all(len(colour) == 7 for colour in found)
