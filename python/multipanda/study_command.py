"""The command `multipanda study`."""

from __future__ import annotations

import argparse
import json
import sys

from .errors import Error, Refused
from .study import study


def main() -> int:
    parser = argparse.ArgumentParser(prog="multipanda study", add_help=False)
    parser.add_argument("file")
    parser.add_argument("--executor", default="local")
    parser.add_argument("--out")
    parser.add_argument("--workers", type=int)
    parser.add_argument("--batch", type=int)
    for name in ("--json", "--no-page", "--any-machine"):
        parser.add_argument(name, action="store_true")
    options = parser.parse_args()
    terminal = sys.stderr.isatty()

    def say(text: str) -> None:
        print(f"\r{text}\x1b[K" if terminal else text, end="" if terminal else "\n", file=sys.stderr, flush=True)

    try:
        found = study(
            options.file,
            options.executor,
            out=options.out,
            workers=options.workers,
            batch=options.batch,
            any_machine=options.any_machine,
            page=not options.no_page,
            progress=say,
        )
    except Refused as refused:
        print(f"multipanda study: {refused}", file=sys.stderr)
        return 2
    except Error as error:
        print(f"multipanda study: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\nstopped; the same command resumes it", file=sys.stderr)
        return 130
    print(file=sys.stderr) if terminal else None
    for entry in found.errors[:10]:
        print(f"no result: {json.dumps(entry)}", file=sys.stderr)
    print(f"table: {found.table}", file=sys.stderr)
    if found.page:
        print(f"report: {found.page}", file=sys.stderr)
    if options.json:
        answer = {
            "success": found.success,
            "runs": len(found.rows) + len(found.errors),
            "skipped": found.skipped,
            "faulty": sum(not row["success"] for row in found.rows),
            "errors": found.errors,
            "beyond_ms": 1e3 * found.beyond_s,
            "table": str(found.table),
            "report": str(found.page) if found.page else None,
        }
        print(json.dumps(answer))
    return 0 if found.success else 1
