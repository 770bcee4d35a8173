"""The contents of a recording file, as columns."""

from rerun.chunk import RrdReader


def read_recording_columns(path, static=False):
    """Return the columns of a recording (file for the viewer Rerun), for tests.

    Parameters
    ----------
    path
        Recording file (`.rrd`).
    static
        False: return the data that were logged for each sample. True: return the data that
        were logged once and have no time.

    Returns
    -------
    dict
        List of the values of all rows, by path of the entity (what is shown) and name of
        the component ("Scalars:scalars") or timeline ("sample"). Data logged for each
        sample are in the order of the samples.
    """
    columns = {}
    chunks = [chunk for chunk in RrdReader(path).stream() if chunk.is_static == static]
    batches = [(chunk.entity_path, chunk.to_record_batch()) for chunk in chunks]
    if not static:
        # A batch has consecutive samples of one entity. Its first sample gives its
        # position.
        batches.sort(key=lambda item: (item[0], item[1].column("sample")[0].as_py()))
    for entity, batch in batches:
        for name in batch.schema.names:
            if name == "rerun.controls.RowId":
                continue
            values = batch.column(name)
            # Arrow stores times as whole numbers of a unit. The cast keeps these numbers;
            # otherwise they would become objects of Python.
            if name == "time":
                values = values.cast("int64")
            columns.setdefault((entity, name), []).extend(values.to_pylist())
    return columns
