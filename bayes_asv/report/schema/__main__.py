"""Write the JSON Schema of every document: ``python -m bayes_asv.report.schema [FOLDER]``."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from bayes_asv.report.schema import DOCUMENTS

__all__ = ["json_schemas", "main"]


def json_schemas() -> dict[str, str]:
    """Text of every JSON Schema by file name, such as ``estimate-1.json``."""
    files = {}
    for name, document in DOCUMENTS.items():
        schema = {
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            **document.model_json_schema(),
        }
        kind, version = name.split("/")[1:]
        text = json.dumps(schema, indent=1, ensure_ascii=False, sort_keys=True)
        files[f"{kind}-{version}.json"] = text + "\n"
    return files


def main(folder: str = "docs/schema") -> None:
    """Write the files."""
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    for name, text in json_schemas().items():
        (target / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:2])
