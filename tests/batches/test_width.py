"""The number of cases of a group on a GPU: a power of two that fits into its memory."""

from jaxid.batches.width import NARROW, WIDEST, WORKING_SHARE, accelerator_width

SMALL, LARGE = 13_000, 2_000_000  # slots of a spring and of an aircraft [bytes]
MEMORY = 100_000_000_000


def test_width_fits_into_memory_and_is_power_of_two():
    for slot in (SMALL, LARGE, 200_000_000):
        width = accelerator_width(100_000, slot, MEMORY)
        assert width & (width - 1) == 0
        assert WORKING_SHARE * slot * width <= MEMORY
        assert width == WIDEST or 2 * WORKING_SHARE * slot * width > MEMORY


def test_few_cases_take_the_narrow_width_and_one_case_always_fits():
    assert accelerator_width(1, SMALL, MEMORY) == NARROW
    assert accelerator_width(NARROW + 1, SMALL, MEMORY) == WIDEST
    assert accelerator_width(1, LARGE, 1_000_000) == 1
