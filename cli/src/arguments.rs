//! The command line.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand, ValueEnum};

const EXIT_CODES: &str = "\
Exit codes:
  0    done
  1    the run failed; what was done is kept, and the same command takes it up again
  2    bad input: arguments, config or option set; nothing was started
  3    the run directory is in use by another process
  129, 130, 143    stopped by a closed terminal, by Ctrl-C, by a request to terminate; the same command takes it up again";

/// Finds early-life options: short motor behaviours that a robot can run at random from its first second and still do
/// well over a whole family of tasks (Weber et al. 2019).
#[derive(Debug, Parser)]
#[command(name = "elo", version, after_help = EXIT_CODES)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run a config from teachers to selected option sets, or take up an interrupted run.
    Discover(Discover),
    /// Measure a finished option set on fresh contexts, on any simulator of its robot.
    Evaluate(Evaluate),
    /// List everything that a config can choose by its kind.
    Plugins,
    /// Print a commented config: of one kind, or of a whole experiment with the kind `experiment`.
    Example {
        /// A kind that `elo plugins` lists, or `experiment`.
        kind: String,
    },
    /// Check a config, show it resolved, or print the JSON Schema.
    Config {
        #[command(subcommand)]
        action: ConfigAction,
    },
    /// Measure a finished run's options in the same contexts on other engines.
    Crosscheck(Crosscheck),
    /// Price a finished run's rollouts for another range of tasks, without simulating.
    Reprice(Reprice),
    /// Compare the option sets of two runs on common contexts.
    Compare(Compare),
    /// Measure the paper's figures and tables on a finished run.
    Experiments(Experiments),
    /// Run the paper's experiments and print each figure beside the paper's, or take up an interrupted reproduction.
    Reproduce(Reproduce),
    /// Write finished runs as one page: figures, plots and a replay in three dimensions. It opens without a network.
    Report(Report),
    /// Tell which engines were found, and what to run for those that are missing.
    Doctor(Doctor),
}

/// Arguments of `elo doctor`.
#[derive(Debug, Args)]
pub struct Doctor {
    /// A config whose `[workers]` names the interpreter to look in [default: python3 of the search path]
    pub config: Option<PathBuf>,
}

/// Arguments of `elo discover`.
#[derive(Debug, Args)]
pub struct Discover {
    /// The experiment, a TOML file.
    pub config: PathBuf,
    /// Run directory [default: runs/ and the config's name]. Work that is already there is not done again.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Change a field, e.g. --set simulator.kind=mujoco; may be repeated. Paths are relative to the config, as in the file.
    #[arg(long = "set", value_name = "FIELD=VALUE")]
    pub overrides: Vec<String>,
    /// Units of work under way at once [default: one a processor]. Results do not depend on it.
    #[arg(long)]
    pub workers: Option<usize>,
    /// Print what the run would take (simulator steps, disk, time) and stop.
    #[arg(long, conflicts_with = "json")]
    pub plan: bool,
    /// Print the report as JSON instead of a table.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `elo evaluate`.
#[derive(Debug, Args)]
pub struct Evaluate {
    /// The folder of an option set, e.g. runs/half-cheetah-quick/results/option_sets/maximum_mean.
    pub option_set: PathBuf,
    /// Change a field of the experiment that made it, e.g. --set simulator.kind=mujoco or --set report.contexts=1000;
    /// may be repeated.
    #[arg(long = "set", value_name = "FIELD=VALUE")]
    pub overrides: Vec<String>,
    /// Root seed of the contexts [default: one more than that of the run that made the set].
    #[arg(long)]
    pub seed: Option<u64>,
    /// Run directory to keep the rollouts in [default: a temporary one].
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Units of work under way at once [default: one a processor].
    #[arg(long)]
    pub workers: Option<usize>,
    /// Print the figures as JSON instead of a table.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `elo crosscheck`.
#[derive(Debug, Args)]
pub struct Crosscheck {
    /// A run directory that `elo discover` finished.
    pub run: PathBuf,
    /// Another simulator: a kind, e.g. mujoco, which keeps the run's other fields, or a TOML file with a [simulator] table;
    /// may be repeated.
    #[arg(long = "simulator", value_name = "KIND|FILE", required = true)]
    pub simulators: Vec<String>,
    /// Held-out contexts in which every candidate is measured on every engine.
    #[arg(long, default_value_t = 30)]
    pub contexts: usize,
    /// Units of work under way at once [default: one a processor].
    #[arg(long)]
    pub workers: Option<usize>,
    /// Print the figures as JSON instead of a table.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `elo reprice`.
#[derive(Debug, Args)]
pub struct Reprice {
    /// A run directory that `elo discover` finished.
    pub run: PathBuf,
    /// The new range of a task parameter, e.g. electricity_cost=-4..-3; may be repeated. Others keep the run's range.
    #[arg(long = "tasks", value_name = "NAME=LOW..HIGH", required = true)]
    pub tasks: Vec<String>,
    /// Print the figures as JSON instead of a table.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `elo compare`.
#[derive(Debug, Args)]
pub struct Compare {
    /// A run directory that `elo discover` finished; simulator, tasks and contexts are its own.
    pub first: PathBuf,
    /// Another one, of the same robot.
    pub second: PathBuf,
    /// Units of work under way at once [default: one a processor].
    #[arg(long)]
    pub workers: Option<usize>,
    /// Print the figures as JSON instead of a table.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `elo experiments`.
#[derive(Debug, Args)]
pub struct Experiments {
    /// A run directory that `elo discover` finished.
    pub run: PathBuf,
    /// Units of work under way at once [default: one a processor].
    #[arg(long)]
    pub workers: Option<usize>,
    /// Print the figures as JSON instead of tables.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `elo reproduce`.
#[derive(Debug, Args)]
pub struct Reproduce {
    /// ant, half-cheetah or walker2d; may be repeated [default: all three].
    #[arg(long = "robot", value_name = "ROBOT")]
    pub robots: Vec<String>,
    /// The engine: rapier, or mujoco after `tests/set-up`.
    #[arg(long, default_value = "rapier")]
    pub simulator: String,
    /// Minutes of small sizes, or hours of the paper's.
    #[arg(long, value_enum, default_value = "quick")]
    pub scale: Scale,
    /// Change a field of every config, e.g. --set teacher.steps=1000000; may be repeated. Another folder should go with it.
    #[arg(long = "set", value_name = "FIELD=VALUE")]
    pub overrides: Vec<String>,
    /// Whole pipelines with seeds 1, 2, …; from three on, intervals are over them, and two show their range.
    #[arg(long, default_value_t = 1)]
    pub seeds: u64,
    /// Where the run directories and the results go.
    #[arg(long, default_value = "runs/reproduce")]
    pub out: PathBuf,
    /// Units of work under way at once [default: one a processor].
    #[arg(long)]
    pub workers: Option<usize>,
    /// Print the figures as JSON instead of tables.
    #[arg(long)]
    pub json: bool,
}

/// See [`Reproduce::scale`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Scale {
    /// 2 teachers of 300,000 steps, 40 candidates, 40 contexts to choose in, 60 held-out ones.
    Quick,
    /// 10 teachers of 2 million steps, 600 candidates, 300 contexts to choose in, 300 held-out ones.
    Paper,
}

/// Arguments of `elo report`.
#[derive(Debug, Args)]
pub struct Report {
    /// Run directories that `elo discover` finished.
    #[arg(value_name = "RUN", required = true)]
    pub runs: Vec<PathBuf>,
    /// The page. Its plots are also written as files, into the folder beside it whose name ends in -plots.
    #[arg(long, default_value = "report.html")]
    pub out: PathBuf,
    /// Another simulator, for a replay of two engines side by side: a kind, e.g. mujoco, or a TOML file with a [simulator]
    /// table.
    #[arg(long, value_name = "KIND|FILE")]
    pub simulator: Option<String>,
    /// Held-out contexts whose rollouts the replay shows; 0 for none.
    #[arg(long, default_value_t = 3)]
    pub replays: usize,
    /// Units of work under way at once [default: one a processor].
    #[arg(long)]
    pub workers: Option<usize>,
}

/// What to do with a config.
#[derive(Debug, Subcommand)]
pub enum ConfigAction {
    /// Find every fault of a config.
    Check(ConfigFile),
    /// Print a config with every default written out.
    Show(ConfigFile),
    /// Print the JSON Schema of configs with all plugins, for editors.
    Schema,
}

/// A config and changes to it.
#[derive(Debug, Args)]
pub struct ConfigFile {
    /// The experiment, a TOML file.
    pub config: PathBuf,
    /// Change a field; may be repeated.
    #[arg(long = "set", value_name = "FIELD=VALUE")]
    pub overrides: Vec<String>,
}

/// Reads the arguments, or tells how the process is to end.
pub fn parse() -> Result<Command, ExitCode> {
    match Cli::try_parse() {
        Ok(cli) => Ok(cli.command),
        Err(error) => {
            // Help asked for goes to stdout and is no error; a closed pipe there is nobody's fault.
            let _ = error.print();
            Err(ExitCode::from(if error.use_stderr() { 2 } else { 0 }))
        }
    }
}
