"""Fills the tables of docs/results/closed-loop.md from the CSV files in the folder beside it.

    python closed_loop_tables.py            # fills the page
    python closed_loop_tables.py FOLDER     # takes what runs of the protocol gave into the CSV files, then fills the page
    python closed_loop_tables.py --check    # changes nothing, and fails where the page is not what the files say

FOLDER holds any of `ROBOT-SEED-open_loop.json` with `ROBOT-SEED-interest.json` (`elo experiments RUN --json`),
`ROBOT-SEED-ABLATION.json` (`elo discover … --json` of the ablation) and `specialisation.csv` (of the program of that name). Rows of
the same run are replaced, others kept. A table stands in the page between `<!-- NAME -->` and `<!-- / -->`; the text
around it is left alone. Every table of ablations says how many seeds it has where they are not three.
"""

import csv
import json
import math
import random
import re
import statistics
import sys
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs/results/closed-loop.md"
FILES = PAGE.with_suffix("")
ROBOTS = {"ant": "Ant", "half-cheetah": "HalfCheetah", "walker2d": "Walker2d"}
SEEDS = range(1, 6)
CONTEXTS = 300
METRICS = ("maximum_mean", "negative_tail")
TEACHERS, PPO = "teachers, mean action", "PPO, 0.5 M steps, by samples"
LEARNERS = ["interest", "open_loop", "behavior_cloning"]
ARMS = [*LEARNERS, "random torque", "zero torque", TEACHERS, PPO]
ABLATIONS = {
    "interests": "without interests",
    "termination": "without learning `ε`",
    "scratch": "without imitation start",
    "diversity": "with diversity",
    "one": "one option",
}
# Student's 97.5 % quantiles by degrees of freedom.
STUDENT = {1: 12.706, 2: 4.303, 3: 3.182, 4: 2.776}


def student(values):
    """Mean and 95 % interval over seeds, as text."""
    mean = statistics.mean(values)
    if len(values) == 1:
        return f"{mean:.1f}"
    half = STUDENT[len(values) - 1] * statistics.stdev(values) / math.sqrt(len(values))
    return f"{mean:.1f} [{mean - half:.1f}, {mean + half:.1f}]"


def bootstrap(values, draws=2000):
    """95 % percentile interval of the mean."""
    stream = random.Random(1)
    means = sorted(statistics.fmean(stream.choices(values, k=len(values))) for _ in range(draws))
    return means[int(0.025 * draws)], means[int(0.975 * draws)]


def by_context(agent):
    """An agent's mean return in each context; options follow each other within a context."""
    returns = agent["returns"]
    each = len(returns) // CONTEXTS
    return [statistics.fmean(returns[i * each : (i + 1) * each]) for i in range(CONTEXTS)]


def agents(open_loop, interest, metric):
    """The arms of one seed, by name; `metric` is how the sets' names begin."""

    def find(report, wanted):
        return next(agent for agent in report["agents"] if wanted(agent["row"]["name"]))

    def named(report, prefix):
        return find(report, lambda name: name.startswith(prefix))

    return {
        "interest": named(interest, metric),
        "open_loop": named(open_loop, metric),
        "behavior_cloning": named(open_loop, f"behavior_cloning: {metric}"),
        "random torque": named(interest, "random torque"),
        "zero torque": named(interest, "zero torque"),
        TEACHERS: named(open_loop, "teachers"),
        PPO: find(open_loop, lambda name: "after" in name),
    }


def figures(row):
    """What runs.csv has of a row of a report."""
    mean = row["mean_return"]
    return {
        "mean_return": mean["estimate"],
        "low": mean["low"],
        "high": mean["high"],
        "falls": row["falls"]["estimate"],
        "mean_length": row["mean_length"],
    }


def rows_of(robot, seed, metric, arms):
    """One line of runs.csv for each arm."""
    base = by_context(arms["interest"])
    for name, agent in arms.items():
        row = agent["row"]
        line = {
            "robot": robot,
            "seed": seed,
            "metric": metric,
            "arm": name,
            **figures(row),
            "falls_at_most": agent["falls"]["upper"],
        }
        if name != "interest":
            differences = [a - b for a, b in zip(base, by_context(agent), strict=True)]
            line["difference"] = statistics.fmean(differences)
            line["difference_low"], line["difference_high"] = bootstrap(differences)
        yield line


def rows_of_ablation(robot, seed, kind, report, base):
    """One line of runs.csv for each metric; `base` has those of `interest`. Contexts are the same, so the difference of means
    is the mean of differences; its interval over contexts would need both runs in one place."""
    for found in report["sets"]:
        row, metric = found["row"], found["metric"].partition("(")[0]
        yield {
            "robot": robot,
            "seed": seed,
            "metric": metric,
            "arm": kind,
            **figures(row),
            "difference": base[metric] - row["mean_return"]["estimate"],
        }


class Store:
    """A CSV file whose rows have a key of some columns; rows that are put replace those of the same key."""

    def __init__(self, name, key):
        self.path, self.key = FILES / name, key
        with self.path.open() as file:
            reader = csv.DictReader(file)
            self.columns, self.rows = reader.fieldnames, list(reader)

    def key_of(self, row):
        return [str(row[column]) for column in self.key]

    def put(self, rows):
        rows = [{k: f"{v:.4f}" if isinstance(v, float) else str(v) for k, v in row.items()} for row in rows]
        new = [self.key_of(row) for row in rows]
        self.rows = [row for row in self.rows if self.key_of(row) not in new] + rows
        self.rows.sort(key=self.key_of)

    def write(self):
        with self.path.open("w") as file:
            writer = csv.DictWriter(file, self.columns, restval="", lineterminator="\n")
            writer.writeheader()
            writer.writerows(self.rows)


class Runs:
    """Everything that the CSV files hold."""

    def __init__(self):
        self.stores = {
            "runs": Store("runs.csv", ["robot", "seed", "metric", "arm"]),
            "equivalents": Store("equivalents.csv", ["robot", "seed", "arm"]),
            "specialisation": Store("specialisation.csv", ["run", "option"]),
        }

    def take(self, folder):
        """Puts what runs gave into the files."""
        for path in sorted(folder.glob("*-interest.json")):
            robot, seed, _ = path.stem.rsplit("-", 2)
            interest = json.loads(path.read_text())
            open_loop = json.loads(path.with_name(f"{robot}-{seed}-open_loop.json").read_text())
            for metric in METRICS:
                self.stores["runs"].put(rows_of(robot, seed, metric, agents(open_loop, interest, metric)))
            reports = {"open_loop": open_loop, "interest": interest}
            self.stores["equivalents"].put(
                {"robot": robot, "seed": seed, "arm": arm, **crossing(report)} for arm, report in reports.items()
            )
        for kind in ABLATIONS:
            for path in sorted(folder.glob(f"*-{kind}.json")):
                robot, seed, _ = path.stem.rsplit("-", 2)
                base = {m: self.line("interest", robot, seed, m)["mean_return"] for m in METRICS}
                report = json.loads(path.read_text())
                self.stores["runs"].put(rows_of_ablation(robot, seed, kind, report, base))
        if (folder / "specialisation.csv").exists():
            with (folder / "specialisation.csv").open() as file:
                self.stores["specialisation"].put(list(csv.DictReader(file)))
        for store in self.stores.values():
            store.write()

    def of(self, arm, robot, metric="maximum_mean"):
        """Lines of an arm, one a seed."""
        rows = self.stores["runs"].rows
        wanted = [row for row in rows if (row["arm"], row["robot"], row["metric"]) == (arm, robot, metric)]
        text = ("robot", "metric", "arm")
        return [{k: v if k in text else float(v) for k, v in row.items() if v != ""} for row in wanted]

    def line(self, arm, robot, seed, metric):
        return next(line for line in self.of(arm, robot, metric) if line["seed"] == int(seed))

    def crossing(self, robot, seed, arm):
        rows = self.stores["equivalents"].rows
        return next(r for r in rows if (r["robot"], r["seed"], r["arm"]) == (robot, str(seed), arm))

    def options(self, run):
        return [row for row in self.stores["specialisation"].rows if row["run"] == run]


def crossing(report):
    """After how many steps of training a teacher first earns as much; empty where it never does."""
    found = next(e for e in report["equivalents"] if e["agent"] == "maximum_mean" and e["acts"] == "sample")

    def steps(at):
        return round(at["at"]) if isinstance(at, dict) else {"above_curve": "", "below_curve": 0}[at]

    return {name: steps(found[name]) for name in ("steps", "low", "high")}


def table(head, rows):
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def summary(lines):
    """Return, falls and steps, means over seeds."""
    mean = {key: statistics.fmean(line[key] for line in lines) for key in ("mean_return", "falls", "mean_length")}
    return f"{mean['mean_return']:.1f}, {100 * mean['falls']:.0f} %, {mean['mean_length']:.0f}"


def title(arm):
    """Learners are words of a config."""
    return f"`{arm}`" if arm in LEARNERS else arm


def earn(runs):
    rows = [[title(arm), *(summary(runs.of(arm, robot)) for robot in ROBOTS)] for arm in ARMS]
    return table(["", *ROBOTS.values()], rows)


def differences(runs):
    def cell(arm, robot):
        return student([line["difference"] for line in runs.of(arm, robot)])

    rows = [[title(arm), *(cell(arm, robot) for robot in ROBOTS)] for arm in ARMS[1:5]]
    return table(["`interest` less", *ROBOTS.values()], rows)


def falls(runs):
    def cell(arm, robot):
        pairs = zip(runs.of("interest", robot), runs.of(arm, robot), strict=True)
        return student([100 * (ours["falls"] - theirs["falls"]) for ours, theirs in pairs])

    rows = [[title(arm), *(cell(arm, robot) for robot in ROBOTS)] for arm in ARMS[1:3]]
    return table(["falls of `interest` less those of, in points", *ROBOTS.values()], rows)


def seeds(runs):
    def difference(line):
        return f"{line['difference']:.1f} [{line['difference_low']:.1f}, {line['difference_high']:.1f}]"

    rows = []
    for robot, name in ROBOTS.items():
        for ours, open_loop, cloned in zip(*(runs.of(arm, robot) for arm in LEARNERS), strict=True):
            rows.append(
                [
                    name,
                    f"{ours['seed']:.0f}",
                    f"{ours['mean_return']:.1f} [{ours['low']:.1f}, {ours['high']:.1f}]",
                    difference(open_loop),
                    difference(cloned),
                    f"{100 * ours['falls']:.0f} %, at most {100 * ours['falls_at_most']:.0f} %",
                    f"{100 * open_loop['falls']:.0f} %",
                ]
            )
    head = ["robot", "seed", "`interest`", "less `open_loop`", "less `behavior_cloning`", "falls"]
    return table([*head, "falls of `open_loop`"], rows)


def equivalents(runs):
    def steps(text):
        return f"{int(text):,}" if text else "more than 2,000,896"

    def cell(robot, seed, arm):
        found = runs.crossing(robot, seed, arm)
        within = f" [{steps(found['low'])}, {steps(found['high'])}]" if found["steps"] else ""
        return steps(found["steps"]) + within

    rows = [
        [name, str(seed), cell(robot, seed, "open_loop"), cell(robot, seed, "interest")]
        for robot, name in ROBOTS.items()
        for seed in SEEDS
    ]
    return table(["robot", "seed", "`open_loop`", "`interest`"], rows)


def shares(options):
    """Shares of the draws, most first."""
    found = sorted((100 * float(row["share"]) for row in options), reverse=True)
    return ", ".join(f"{share:.0f} %" if share >= 0.5 else "0" for share in found)


def parts(options):
    """What a set's options do in it: shares of the draws, information, actions."""
    return shares(options), f"{max(0.0, float(options[0]['information'])):.2f}", float(options[0]["actions"])


def options(runs):
    rows = []
    for robot, name in ROBOTS.items():
        for seed in SEEDS:
            drawn, information, actions = parts(runs.options(f"{robot}-{seed}-interest"))
            rows.append([name, str(seed), drawn, information, f"{actions:.1f}", f"{actions - 1:.1f}"])
    head = ["robot", "seed", "draws of each option, most first", "information, nats"]
    return table([*head, "actions", "continuations ρ"], rows)


def ablations(runs):
    def cell(kind, robot):
        lines = runs.of(kind, robot)
        if not lines:
            return ""
        few = "" if len(lines) == 3 else f" ({len(lines)} seed{'s' if len(lines) > 1 else ''})"
        return student([-line["difference"] for line in lines]) + few

    rows = [[name, *(cell(kind, robot) for robot in ROBOTS)] for kind, name in ABLATIONS.items()]
    return table(["less `interest`", *ROBOTS.values()], rows)


def ablation_runs(runs):
    rows = []
    for kind, what in ABLATIONS.items():
        for robot, name in ROBOTS.items():
            for line in runs.of(kind, robot):
                seed = f"{line['seed']:.0f}"
                drawn, information, actions = parts(runs.options(f"{robot}-{seed}-{kind}"))
                earned, fell = f"{line['mean_return']:.1f}", f"{100 * line['falls']:.0f} %"
                rows.append([what, name, seed, earned, fell, drawn, information, f"{actions - 1:.1f}"])
    head = ["what", "robot", "seed", "return", "falls", "draws of each option", "information, nats"]
    return table([*head, "continuations ρ"], rows)


def filled(page, runs):
    """The text of the page with its tables as the files say."""
    for of in (earn, differences, falls, seeds, equivalents, options, ablations, ablation_runs):
        block = re.compile(rf"(<!-- {of.__name__} -->\n).*?(<!-- / -->)", re.DOTALL)
        inside = f"\n{of(runs)}\n\n"
        page, count = block.subn(lambda match, inside=inside: match[1] + inside + match[2], page)
        if count != 1:
            sys.exit(f"{PAGE}: expected one table `{of.__name__}`, found {count}")
    return page


def main(arguments):
    runs, page = Runs(), PAGE.read_text()
    if arguments == ["--check"]:
        if filled(page, runs) != page:
            sys.exit(f"{PAGE}: its tables are not what {FILES} says; {Path(__file__).name} fills them")
        return
    for folder in arguments:
        runs.take(Path(folder))
    PAGE.write_text(filled(page, runs))


if __name__ == "__main__":
    main(sys.argv[1:])
