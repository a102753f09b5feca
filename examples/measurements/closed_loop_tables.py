"""Fills the tables of docs/results/closed-loop.md, and runs.csv beside it, from what the runs of its protocol gave.

    python closed_loop_tables.py FOLDER

FOLDER holds `ROBOT-SEED-open_loop.json` and `ROBOT-SEED-interest.json` (`elo experiments RUN --json`),
`ROBOT-SEED-ABLATION.json` (`elo compare INTEREST-RUN ABLATION-RUN --json`) and `specialisation.csv` (of the program of that
name). A table stands in the page between `<!-- NAME -->` and `<!-- / -->`; the text around it is left alone. Runs that are
missing are left out, and every table says how many seeds it has where they are not five.
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
ROBOTS = {"ant": "Ant", "half-cheetah": "HalfCheetah", "walker2d": "Walker2d"}
SEEDS = range(1, 6)
CONTEXTS = 300
TEACHERS, PPO = "teachers, mean action", "PPO, 0.5 M steps, by samples"
ARMS = ["`interest`", "`open_loop`", "`behavior_cloning`", "random torque", "zero torque", TEACHERS, PPO]
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
        "`interest`": named(interest, metric),
        "`open_loop`": named(open_loop, metric),
        "`behavior_cloning`": named(open_loop, f"behavior_cloning: {metric}"),
        "random torque": named(interest, "random torque"),
        "zero torque": named(interest, "zero torque"),
        TEACHERS: named(open_loop, "teachers"),
        PPO: find(open_loop, lambda name: "after" in name),
    }


def rows_of(robot, seed, metric, arms):
    """One line of runs.csv for each arm."""
    base = by_context(arms["`interest`"])
    for name, agent in arms.items():
        row = agent["row"]
        line = {
            "robot": robot,
            "seed": seed,
            "metric": metric,
            "arm": name.strip("`"),
            "mean_return": row["mean_return"]["estimate"],
            "low": row["mean_return"]["low"],
            "high": row["mean_return"]["high"],
            "falls": row["falls"]["estimate"],
            "falls_at_most": agent["falls"]["upper"],
            "mean_length": row["mean_length"],
        }
        if name != "`interest`":
            differences = [a - b for a, b in zip(base, by_context(agent), strict=True)]
            line["difference"] = statistics.fmean(differences)
            line["difference_low"], line["difference_high"] = bootstrap(differences)
        yield name, line


class Runs:
    """Everything that the folder holds."""

    def __init__(self, folder):
        self.folder = Path(folder)
        self.lines, self.reports = {}, {}
        self.options = self.read_options()
        for robot in ROBOTS:
            for seed in SEEDS:
                self.read(robot, seed)

    def load(self, name):
        path = self.folder / f"{name}.json"
        return json.loads(path.read_text()) if path.exists() else None

    def read(self, robot, seed):
        reports = [self.load(f"{robot}-{seed}-{arm}") for arm in ("open_loop", "interest")]
        if None in reports:
            return
        self.reports[robot, seed] = reports
        for metric in ("maximum_mean", "negative_tail"):
            for name, line in rows_of(robot, seed, metric, agents(*reports, metric)):
                self.lines.setdefault((metric, name, robot), []).append(line)

    def of(self, name, robot):
        return self.lines.get(("maximum_mean", name, robot), [])

    def ablations(self, kind, robot):
        """(seed, comparison of `interest` with the ablation)."""
        found = [(seed, self.load(f"{robot}-{seed}-{kind}")) for seed in SEEDS]
        return [(seed, report["pairs"][0]) for seed, report in found if report]

    def read_options(self):
        """Rows of specialisation.csv by run."""
        runs = {}
        with (self.folder / "specialisation.csv").open() as file:
            for row in csv.DictReader(file):
                runs.setdefault(row["run"], []).append(row)
        return runs


def table(head, rows):
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def summary(lines):
    """Return, falls and steps, means over seeds."""
    mean = {key: statistics.fmean(line[key] for line in lines) for key in ("mean_return", "falls", "mean_length")}
    return f"{mean['mean_return']:.1f}, {100 * mean['falls']:.0f} %, {mean['mean_length']:.0f}"


def earn(runs):
    rows = [[name, *(summary(runs.of(name, robot)) for robot in ROBOTS)] for name in ARMS]
    return table(["", *ROBOTS.values()], rows)


def differences(runs):
    def cell(name, robot):
        return student([line["difference"] for line in runs.of(name, robot)])

    rows = [[name, *(cell(name, robot) for robot in ROBOTS)] for name in ARMS[1:5]]
    return table(["`interest` less", *ROBOTS.values()], rows)


def falls(runs):
    def cell(name, robot):
        pairs = zip(runs.of("`interest`", robot), runs.of(name, robot), strict=True)
        return student([100 * (ours["falls"] - theirs["falls"]) for ours, theirs in pairs])

    rows = [[name, *(cell(name, robot) for robot in ROBOTS)] for name in ARMS[1:3]]
    return table(["falls of `interest` less those of, in points", *ROBOTS.values()], rows)


def seeds(runs):
    def difference(line):
        return f"{line['difference']:.1f} [{line['difference_low']:.1f}, {line['difference_high']:.1f}]"

    rows = []
    for robot, title in ROBOTS.items():
        for ours, open_loop, cloned in zip(*(runs.of(name, robot) for name in ARMS[:3]), strict=True):
            rows.append(
                [
                    title,
                    str(ours["seed"]),
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
    def steps(at):
        texts = {"above_curve": "more than 2,000,896", "below_curve": "0"}
        return f"{at['at']:,.0f}" if isinstance(at, dict) else texts[at]

    def cell(report):
        found = next(e for e in report["equivalents"] if e["agent"] == "maximum_mean" and e["acts"] == "sample")
        within = "" if found["steps"] == "above_curve" else f" [{steps(found['low'])}, {steps(found['high'])}]"
        return steps(found["steps"]) + within

    rows = [
        [ROBOTS[robot], str(seed), *(cell(report) for report in reports)]
        for (robot, seed), reports in runs.reports.items()
    ]
    return table(["robot", "seed", "`open_loop`", "`interest`"], rows)


def draws(options):
    """Shares of the draws, most first."""
    shares = sorted((100 * float(row["share"]) for row in options), reverse=True)
    return ", ".join(f"{share:.0f} %" if share >= 0.5 else "0" for share in shares)


def options(runs):
    rows = []
    for robot, title in ROBOTS.items():
        for seed in SEEDS:
            found = runs.options.get(f"{robot}-{seed}-interest")
            if found:
                actions = float(found[0]["actions"])
                information = float(found[0]["information"])
                rows.append(
                    [title, str(seed), draws(found), f"{information:.2f}", f"{actions:.1f}", f"{actions - 1:.1f}"]
                )
    head = ["robot", "seed", "draws of each option, most first", "information, nats"]
    return table([*head, "actions", "continuations ρ"], rows)


def ablations(runs):
    def cell(kind, robot):
        pairs = [pair for _, pair in runs.ablations(kind, robot)]
        if not pairs:
            return ""
        few = "" if len(pairs) == 3 else f" ({len(pairs)} seed{'s' if len(pairs) > 1 else ''})"
        return student([pair["difference"]["estimate"] for pair in pairs]) + few

    rows = [[title, *(cell(kind, robot) for robot in ROBOTS)] for kind, title in ABLATIONS.items()]
    return table(["less `interest`", *ROBOTS.values()], rows)


def ablation_runs(runs):
    rows = []
    for kind, title in ABLATIONS.items():
        for robot, name in ROBOTS.items():
            for seed, pair in runs.ablations(kind, robot):
                row = pair["second"]
                drawn = runs.options.get(f"{robot}-{seed}-{kind}", [])
                rows.append(
                    [
                        title,
                        name,
                        str(seed),
                        f"{row['mean_return']['estimate']:.1f}",
                        f"{100 * row['falls']['estimate']:.0f} %",
                        draws(drawn) if drawn else "",
                        f"{float(drawn[0]['information']):.2f}" if drawn else "",
                        f"{float(drawn[0]['actions']) - 1:.1f}" if drawn else "",
                    ]
                )
    head = ["what", "robot", "seed", "return", "falls", "draws of each option", "information, nats"]
    return table([*head, "continuations ρ"], rows)


def write_csv(runs, path):
    lines = [line for group in runs.lines.values() for line in group]
    lines.sort(key=lambda line: (line["robot"], line["seed"], line["metric"]))
    with path.open("w") as file:
        writer = csv.DictWriter(file, max(lines, key=len).keys(), lineterminator="\n")
        writer.writeheader()
        for line in lines:
            writer.writerow({key: f"{v:.4f}" if isinstance(v, float) else v for key, v in line.items()})


def main(folder):
    runs = Runs(folder)
    text = PAGE.read_text()
    for of in (earn, differences, falls, seeds, equivalents, options, ablations, ablation_runs):
        block = re.compile(rf"(<!-- {of.__name__} -->\n).*?(<!-- / -->)", re.DOTALL)
        filled = f"\n{of(runs)}\n\n"
        text, count = block.subn(lambda match, filled=filled: match[1] + filled + match[2], text)
        if count != 1:
            sys.exit(f"{PAGE}: expected one table `{of.__name__}`, found {count}")
    PAGE.write_text(text)
    write_csv(runs, PAGE.with_suffix("") / "runs.csv")


if __name__ == "__main__":
    main(sys.argv[1])
