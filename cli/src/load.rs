//! Reading an experiment: file, overrides, files that it refers to, and every fault at once.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use elo_core::config::{self, ConfigError};
use elo_core::experiment::Experiment;
use elo_core::fault::Faults;
use elo_core::plugin::Plugin;
use elo_core::policy::Unwatched;
use elo_core::results;
use elo_core::units::Work;
use elo_core::workforce::{Job, TRIES, Undone, Workforce};

use crate::exit::Exit;
use crate::hosts::{Programs, remedy};
use crate::output::print_error;

/// The greatest config file that is read: 16 MiB.
const MAX_BYTES: u64 = 16 << 20;

/// Reads and checks the experiment in `path`.
pub fn experiment(path: &Path, overrides: &[String], plugins: &[&[Plugin]]) -> Result<Experiment, Exit> {
    let text = read_text(path)?;
    let folder = path.parent().unwrap_or(Path::new("."));
    checked((&text, path), folder, overrides, plugins).map_err(|error| Exit::BadInput(error.to_string()))
}

/// Reads the experiment that the results of a run directory are of.
pub fn of_run(folder: &Path, plugins: &[&[Plugin]]) -> Result<Experiment, Exit> {
    experiment(&config_of_run(folder)?, &[], plugins).map_err(|exit| {
        // The program that wrote it knew every kind in it.
        if exit.to_string().contains("`: expected a kind of ") {
            exit.with_hint(
                "the run was made by a program with plugins that this one has not: use that program",
            )
        } else {
            exit
        }
    })
}

/// The config that the results of a run directory are of. Says so where work on another has been begun there since.
pub fn config_of_run(folder: &Path) -> Result<PathBuf, Exit> {
    let [begun, finished] = ["experiment.toml", results::CONFIG].map(|name| folder.join(name));
    let missing = |what: &str| Err(Exit::BadInput(format!("{}: {what}", folder.display())));
    if !begun.is_file() {
        return missing(
            "is no run directory: it has no experiment.toml; `elo discover CONFIG --out DIRECTORY` makes one",
        );
    }
    if !finished.is_file() {
        return missing(
            "this run is not finished: take it up with `elo discover DIRECTORY/experiment.toml --out DIRECTORY`",
        );
    }
    if read_text(&begun)? != read_text(&finished)? {
        print_error(&format!(
            "{}: another config was begun here since and is not finished; this is about the results that are there",
            folder.display()
        ));
    }
    Ok(finished)
}

/// Checks the experiment that the file `name` holds in another form, which is `text` in TOML.
pub fn embedded(
    text: &str,
    name: &Path,
    overrides: &[String],
    plugins: &[&[Plugin]],
) -> Result<Experiment, Exit> {
    checked((text, name), name.parent().unwrap_or(Path::new(".")), overrides, plugins)
        .map_err(|error| Exit::BadInput(error.without_lines().to_string()))
}

/// Checks the experiment in a text with a name; files that it refers to are looked for in `folder`.
fn checked(
    (text, name): (&str, &Path),
    folder: &Path,
    overrides: &[String],
    plugins: &[&[Plugin]],
) -> Result<Experiment, ConfigError> {
    let mut reading = config::read::<Experiment>(text, name, overrides, plugins)?;
    for notice in &reading.notices {
        print_error(notice);
    }
    let mut faults = Faults::new();
    reading.config.workers.resolve(folder);
    faults.within("simulator", |faults| reading.config.simulator.embed_files(folder, faults));
    if let Some(teacher) = &mut reading.config.teacher {
        faults.within("teacher", |faults| teacher.embed_files(folder, faults));
    }
    if faults.found().is_empty() {
        describe(&mut reading.config, &mut faults);
    }
    if faults.found().is_empty() {
        reading.config.validate(&mut faults);
    }
    if faults.found().is_empty() {
        Ok(reading.config)
    } else {
        Err(reading.places.error(faults.into_found()))
    }
}

/// Has workers say what those plugins are that only their worker knows.
fn describe(experiment: &mut Experiment, faults: &mut Faults) {
    if experiment.hosted_mut().iter().any(|(_, hosted)| hosted.needs_description()) {
        faults.within("workers", |faults| experiment.workers.check_folders(faults));
        if !faults.found().is_empty() {
            return;
        }
    }
    let programs = Programs::of(experiment);
    let workforce = Workforce::new(&programs);
    let mut said = BTreeMap::new();
    for (path, plugin) in experiment.describable() {
        let Some(hosted) = plugin.hosted().filter(|hosted| hosted.needs_description()) else { continue };
        let program = hosted.worker();
        let work = serde_json::to_vec(&Work::from(plugin)).expect("descriptions are plain data");
        let job = Job { program, work: &work, inputs: &[], workers: TRIES };
        match workforce.run(job, &mut Unwatched, &mut |_| ()) {
            Ok(description) => drop(said.insert(path, description)),
            Err(Undone::Start(fault)) => {
                return faults.add("workers.python", format!("{fault}{}", remedy(&program)));
            }
            Err(why) => faults.add(&path, why.to_string()),
        }
    }
    for (path, hosted) in experiment.hosted_mut() {
        if let Some(Err(why)) = said.get(&path).map(|bytes| hosted.accept_description(bytes)) {
            faults.add(&path, why);
        }
    }
}

/// The text of a config file, which must be a regular file of a sensible size.
pub fn read_text(path: &Path) -> Result<String, Exit> {
    let cannot = |why: String| Exit::BadInput(format!("cannot read the config {}: {why}", path.display()));
    let metadata = std::fs::metadata(path).map_err(|error| cannot(error.to_string()))?;
    if !metadata.is_file() {
        return Err(cannot("it is not a regular file".to_owned()));
    }
    if metadata.len() > MAX_BYTES {
        return Err(cannot(format!("it has {} bytes, more than {MAX_BYTES}", metadata.len())));
    }
    let bytes = std::fs::read(path).map_err(|error| cannot(error.to_string()))?;
    String::from_utf8(bytes).map_err(|_| cannot("it is not UTF-8 text".to_owned()))
}
