"""The places of one recording together: a file, viewers, a page of a notebook."""

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from spherekit.errors import OutputError
from spherekit.view.outputs import AbstractOutput, FileOutput, ServedOutput
from spherekit.view.sdk import rr


class Outputs:
    """Places that all get the same.

    `entities` and `rows` are those logged so far; `seen` the paths that came up.
    """

    def __init__(self, places: Iterable[AbstractOutput]) -> None:
        self.places = list(places)
        self.entities: set[str] = set()
        self.seen: set[str] = set()
        self.rows = 0

    @property
    def live(self) -> list[AbstractOutput]:
        """The places where somebody may look on."""
        return [place for place in self.places if not isinstance(place, FileOutput)]

    @property
    def url(self) -> str | None:
        """Address at which the recording is served, if it is."""
        served = (place for place in self.places if isinstance(place, ServedOutput))
        return next((place.url for place in served), None)

    def cost(self, finished: bool) -> dict[str, int]:
        """Return entities and rows logged, and the bytes of a file that is finished."""
        files = [place.path for place in self.places if isinstance(place, FileOutput)]
        whole = sum(path.stat().st_size for path in files) if finished else 0
        return {"entities": len(self.entities), "rows": self.rows, "bytes": whole}

    def open(self) -> None:
        """Open all places, or none."""
        opened: list[AbstractOutput] = []
        try:
            for place in self.places:
                place.open()
                opened.append(place)
        except OutputError:
            for place in opened:
                place.close(keep=False)
            raise

    def close(self, error: BaseException | None) -> None:
        """Let go of all places, and note on an error what was kept."""
        for place in self.places:
            left = place.close(keep=self.rows > 0)
            if left and error is not None:
                error.add_note(left)

    def name(self, name: str, properties: Mapping[str, Any]) -> None:
        """Send the name of the recording, and what is to be known of the run."""
        for place in self.places:
            place.stream.send_recording_name(name)
            if properties:
                place.stream.send_property("run", rr.AnyValues(False, **properties))

    def first(self, path: str) -> bool:
        """Return whether a path comes up for the first time."""
        new = path not in self.seen
        self.seen.add(path)
        return new

    def still(
        self,
        path: str,
        archetype: rr.AsComponents,
        outputs: Sequence[AbstractOutput] | None = None,
    ) -> None:
        """Log what does not move, to some places or to all."""
        self.entities.add(path)
        for output in self.places if outputs is None else outputs:
            output.stream.log(path, archetype, static=True)

    def columns(
        self,
        path: str,
        times: Sequence[rr.TimeColumn],
        columns: Iterable[rr.ComponentColumn],
        rows: int,
    ) -> None:
        """Log rows of what moves."""
        if rows == 0:
            return
        columns = list(columns)
        for output in self.places:
            output.stream.send_columns(path, times, columns)
        self.entities.add(path)
        self.rows += rows

    def each(self, action: Callable[[AbstractOutput], None]) -> None:
        """Do something with each place; a lost viewer does not stop a file."""
        for output in tuple(self.places):
            try:
                action(output)
            except OutputError as error:
                kept = any(isinstance(other, FileOutput) for other in self.places)
                if isinstance(output, FileOutput) or not kept:
                    raise
                warnings.warn(f"{error}; the file goes on", stacklevel=3)
                self.places.remove(output)
                output.close(keep=False)
