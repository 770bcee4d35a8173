"""`spherekit analyses`: what is installed, broken plugins with their reason."""

import json
from argparse import Namespace
from dataclasses import MISSING

PAGE = """
[ANALYSIS]
    describe this one
--json
    as JSON

examples:
  # what is installed
  spherekit analyses
  # its parameters, tables and columns
  spherekit analyses workspace
"""


def execute(options: Namespace) -> int:
    """List the analyses, or describe one."""
    if options.analysis:
        return _describe(options)
    from spherekit.analysis.registry import load, records

    rows = []
    for record in records():
        summary = "" if record.error else load(record.name).summary
        rows.append((record, summary))
    if options.json:
        print(
            json.dumps(
                [
                    {
                        "name": record.name,
                        "origin": record.origin,
                        "target": record.target,
                        "summary": summary,
                        "error": record.error or None,
                    }
                    for record, summary in rows
                ],
                indent=2,
            )
        )
        return 0
    for record, summary in rows:
        print(f"{record.name:20s} {summary or 'BROKEN: ' + record.error}")
    return 0


def _describe(options: Namespace) -> int:
    from spherekit.analysis.arguments import parameters
    from spherekit.analysis.registry import load

    cls = load(options.analysis)
    allowed = parameters(cls)
    if options.json:
        print(
            json.dumps(
                {
                    "name": cls.name,
                    "version": cls.version,
                    "summary": cls.summary,
                    "cites": cls.cites,
                    "parameters": {key: shown for key, (shown, _) in allowed.items()},
                    "tables": {
                        table.name: [
                            {"name": c.name, "unit": c.unit, "meaning": c.meaning}
                            for c in table.columns
                        ]
                        for table in cls.tables
                    },
                },
                indent=2,
            )
        )
        return 0
    print(f"{cls.name} {cls.version}: {cls.summary}")
    for text in cls.cites:
        print(f"  cites {text}")
    print("parameters:" if allowed else "parameters: none")
    for key, (shown, default) in allowed.items():
        value = "required" if default is MISSING else f"default {default!r}"
        print(f"  {key}: {shown}, {value}")
    for table in cls.tables:
        print(f"table {table.name}: {table.meaning}")
        for column in table.columns:
            unit = f" [{column.unit}]" if column.unit else ""
            print(f"  {column.name:14s}{unit:8s} {column.meaning}")
    return 0
