"""Coverage-guided fuzzing of the readers and the loader of results; not part of the test suite.

    python -m tests.hostile.fuzz_readers FOLDER -max_total_time=600

FOLDER keeps the corpus. The first byte of an input says which format the rest is. Whatever ends in anything but an
`InputError` or sound data is a crash, written by libFuzzer beside FOLDER; such inputs go to ``tests/hostile/corpus``,
where the test suite reads them on every run. Needs the package atheris.
"""

from __future__ import annotations

import sys
import tempfile
import warnings
from pathlib import Path

import atheris

with atheris.instrument_imports(
    include=["dqreg.files", "dqreg.registration.result.result", "dqreg.registration.result.invariants"]
):
    from dqreg.errors import InputError
    from dqreg.files import read_geometry
    from dqreg.registration.result.result import Registration
from tests.hostile.good_files import good_files
from tests.hostile.test_files import SUFFIXES, assert_sound

FOLDER = Path(tempfile.mkdtemp())


def read(suffix: str, content: bytes) -> None:
    """Read one input; raises where the readers break their promise."""
    path = FOLDER / f"a{suffix}"
    path.write_bytes(content)
    try:
        if suffix == ".json":
            Registration.load(path)
        else:
            assert_sound(read_geometry(path))
    except InputError:
        pass


def one_input(data: bytes) -> None:
    """Entry point of the fuzzer."""
    if data:
        read(SUFFIXES[data[0] % len(SUFFIXES)], data[1:])


def main() -> None:
    """Seed the corpus with the good files and run."""
    warnings.simplefilter("error")
    corpus = Path(sys.argv[1])
    corpus.mkdir(parents=True, exist_ok=True)
    for name, (suffix, content) in good_files().items():
        (corpus / name.replace(" ", "_")).write_bytes(bytes([SUFFIXES.index(suffix)]) + content)
    from tests.registration.result.test_result import good

    good().save(FOLDER / "seed.json")
    (corpus / "result").write_bytes(bytes([SUFFIXES.index(".json")]) + (FOLDER / "seed.json").read_bytes())
    atheris.Setup(sys.argv, one_input)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
