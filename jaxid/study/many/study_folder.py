"""`StudyFolder`: one JSON file for the result of each of many studies."""

import json
import os
import urllib.parse
from collections.abc import Mapping
from pathlib import Path

from ..._foundation.checks import InputError
from .studies import StudyResult


class StudyFolder:
    """A folder of results, from which a call of `close_loop_many` continues.

    Args:
        path: the folder; it is made if it does not exist.
        identities: version and digest of the arguments of each study by its name. A folder with
            the result of a study of this name and another identity is refused.

    Raises:
        InputError: when the folder cannot be made or read, or a study differs.
    """

    def __init__(self, path: str | Path, identities: Mapping[str, Mapping[str, str]]) -> None:
        self.path, self.identities = Path(path), identities
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(self._refusal(error)) from error
        self._stored = [self._read(name) for name in identities if self._file(name).exists()]

    def results(self) -> dict[str, StudyResult]:
        """Return the results that the folder held when it was opened, without failed studies."""
        return {result.name: result for result in self._stored if result.content is not None}

    def write(self, result: StudyResult) -> None:
        """Write one result; its file is replaced as a whole.

        Raises:
            InputError: when the disk is full or the folder cannot be written; earlier results stay.
        """
        file = self._file(result.name)
        partial = file.with_name(f"{file.name}.partial")
        stored = {
            "identity": dict(self.identities[result.name]),
            "seconds": result.seconds,
            "failure": result.failure,
            "content": result.content,
        }
        try:
            partial.write_text(json.dumps(stored, indent=1))
            os.replace(partial, file)
        except OSError as error:
            raise InputError(self._refusal(error)) from error

    def _read(self, name: str) -> StudyResult:
        """Return the result of a study."""
        file = self._file(name)
        try:
            stored = json.loads(file.read_text())
            known = stored["identity"]
            result = StudyResult(name, stored["seconds"], stored["content"], stored["failure"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(
                f"{str(file)!r} is not the result of a study ({error}). Remove it, or choose "
                "another folder."
            ) from error
        for key, value in self.identities[name].items():
            if known.get(key) != value:
                raise InputError(
                    f"{str(file)!r} belongs to another study: its {key} is "
                    f"{known.get(key, 'missing')!r}, and {value!r} is now given. Call with the "
                    "same arguments, code and versions of jaxid and Python to continue, or choose "
                    "another folder or name."
                )
        return result

    def _file(self, name: str) -> Path:
        """Return the file of a study; characters that a file name cannot have are escaped."""
        return self.path / f"{urllib.parse.quote(name, safe=' ')}.json"

    def _refusal(self, error: OSError) -> str:
        return (
            f"The folder {str(self.path)!r} cannot be written ({error}). The results already in it "
            "remain. Make room or permit writing, and call again to continue."
        )
