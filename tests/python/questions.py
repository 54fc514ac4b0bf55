"""Asks the questions of results/README.md and compares the answers.

Usage: questions.py COORDINATOR SWEEP, where SWEEP is the folder of a finished sweep; needs polars and duckdb.

The SQL blocks under "Ten questions" go to `coordinator query` and to DuckDB, the Python blocks to Python, and all
answers to one question must have the same columns and the same rows in the same order. What the page says of RUN is
asked of the sweep's first member. An empty answer fails, too: it would compare nothing.
"""

import datetime
import json
import math
import pathlib
import re
import subprocess
import sys

import duckdb

PAGE = pathlib.Path(__file__).parents[2] / "results/README.md"
FLOAT = 1e-9  # sums are added up in another order


def plain(value):
    """A value as JSON has it, so that the three can be compared."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, datetime.datetime):
        return value.isoformat(timespec="milliseconds") + "Z"
    return value


def equal(a, b):
    if isinstance(a, float) or isinstance(b, float):
        return a is not None and b is not None and math.isclose(a, b, rel_tol=FLOAT, abs_tol=FLOAT)
    return a == b


class Answer:
    def __init__(self, who, columns, rows):
        self.who, self.columns, self.rows = who, list(columns), [[plain(value) for value in row] for row in rows]

    def differs_from(self, other):
        """What is different, in words; None if nothing is."""
        if sorted(self.columns) != sorted(other.columns):
            return f"columns {self.columns} against {other.columns}"
        if len(self.rows) != len(other.rows):
            return f"{len(self.rows)} rows against {len(other.rows)}"
        places = [other.columns.index(column) for column in self.columns]
        for number, (row, others) in enumerate(zip(self.rows, other.rows)):
            others = [others[place] for place in places]
            if not all(map(equal, row, others)):
                return f"row {number}: {row} against {others}"
        return None


def by_coordinator(coordinator, folder, sql):
    command = [coordinator, "query", folder, sql, "--format", "json"]
    finished = subprocess.run(command, capture_output=True, text=True)
    if finished.returncode != 0:
        sys.exit(f"coordinator query: {finished.stderr}\n{sql}")
    rows = json.loads(finished.stdout)
    return Answer("coordinator query", rows[0] if rows else [], [row.values() for row in rows])


def by_duckdb(sql):
    found = duckdb.sql(sql)
    return Answer("duckdb", found.columns, found.fetchall())


def questions(page):
    """Title and blocks, as (language, text), of every section of the page."""
    for section in re.split(r"^##+ ", page, flags=re.MULTILINE)[1:]:
        title = section.splitlines()[0]
        yield title, re.findall(r"^```(\w+)\n(.*?)^```$", section, flags=re.MULTILINE | re.DOTALL)


def main(coordinator, sweep):
    members = sorted(path.parents[1] for path in pathlib.Path(sweep).glob("*/run/run.parquet"))
    if len(members) < 2:
        sys.exit(f"{sweep}: a finished sweep has several members, got {len(members)}")
    run = str(members[0])
    there = lambda code: code.replace('"RUN', f'"{run}').replace("'RUN", f"'{run}").replace('"SWEEP', f'"{sweep}')
    names, asked, wrong = {}, 0, 0
    for title, blocks in questions(PAGE.read_text()):
        is_question = re.match(r"\d+\. ", title)
        if not is_question and title != "Asking":
            continue
        asked += bool(is_question)
        of_sweep = any("SWEEP" in text for _, text in blocks)
        answers = []  # to what the last SQL block asks
        ways = set()
        for language, text in blocks:
            if language == "python":
                exec(compile(there(text), f"{PAGE.name}: {title}", "exec"), names)
                if is_question:
                    answer = names.pop("answer")
                    answers.append(Answer("python", answer.columns, answer.rows()))
            elif language == "sql":
                names["views"](f"{sweep}/*" if of_sweep else run)
                answers = []
                if "RECURSIVE" not in text:
                    answers.append(by_coordinator(coordinator, sweep if of_sweep else run, text))
                if not text.startswith("DESCRIBE"):
                    answers.append(by_duckdb(text))
            else:
                continue
            ways.add(language)
            if not is_question or len(answers) < 2:
                continue
            first, last = answers[0], answers[-1]
            if text.startswith("import json"):  # DESCRIBE tells more than the file
                places = [first.columns.index(column) for column in last.columns]
                rows = [[row[place] for place in places] for row in first.rows]
                first = Answer(first.who, last.columns, rows)
            difference = "no rows" if not first.rows else first.differs_from(last)
            if difference:
                wrong += 1
                print(f"{title}\n  {first.who} and {last.who} differ: {difference}", file=sys.stderr)
            else:
                print(f"{title} {len(first.rows)} rows: {first.who} = {last.who}")
        if is_question and ways != {"sql", "python"}:
            wrong += 1
            print(f"{title}\n  asked in {sorted(ways)} only", file=sys.stderr)
    if asked != 10:
        sys.exit(f"{PAGE.name}: ten questions are promised, got {asked}")
    if wrong:
        sys.exit(f"{wrong} differences")


if __name__ == "__main__":
    main(*sys.argv[1:])
