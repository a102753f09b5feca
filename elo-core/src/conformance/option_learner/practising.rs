//! Learners that practise: a whole set of options at once, which depends on nothing but the practice.

use std::sync::OnceLock;

use super::super::check::{Check, Finding, Violation};
use super::super::compare::{granted, refused};
use super::super::config::round_trip;
use super::super::interruptible::{
    Interruptible, Stopwatch, Watched, goes_forward, obeys_stops, repeats, resumes, survives_damage,
    tells_progress, threads_change_nothing,
};
use super::{CONFIG_IS_VALID, Case, demonstration, malformed, same_option};
use crate::context::InitialStates;
use crate::policy::{Demonstration, Monitor, OptionLearner, Practice, Practise, Practised, TrainError, Way};
use crate::rollout::Horizon;
use crate::seed::Seed;
use crate::task::TaskDistribution;

/// Every rule, in the order in which they are tried. Costs about fifteen trainings.
pub const CHECKS: &[Check<Case>] = &[
    CONFIG_IS_VALID,
    CONFIG_SURVIVES_FILES,
    PRACTICE_REPEATS,
    THREADS_CHANGE_NOTHING,
    SEEDS_MATTER,
    SETS_HAVE_THE_SIZE_ASKED_FOR,
    LEARNED_OPTIONS_CONFORM,
    STOPS_ARE_OBEYED,
    PRACTICE_RESUMES_WITH_THE_SAME_BYTES,
    DAMAGED_CHECKPOINTS_CHANGE_NOTHING,
    CURVES_GO_FORWARD,
    PROGRESS_IS_HONEST,
    RECORDINGS_ARE_BEGUN_FROM,
    MALFORMED_DEMONSTRATIONS_ARE_REFUSED,
];

/// `K` where a check needs no other.
const SET_SIZE: usize = 2;

/// `T`.
const STEPS: usize = 20;

/// What a practice of the suite has of its own.
struct Trial {
    set_size: usize,
    demonstrations: Vec<Demonstration>,
    seed: u64,
}

impl Case {
    /// The trial that the other ones are variants of: with two recordings, if the learner begins from any.
    fn trial(&self) -> Result<Trial, Violation> {
        let spec = self.spec()?;
        let count = if practising(self.learner.as_ref())?.begins_from_recordings() { SET_SIZE } else { 0 };
        let demonstrations = (0..count).map(|i| demonstration(&spec, 12 + i)).collect();
        Ok(Trial { set_size: SET_SIZE, demonstrations, seed: 1 })
    }

    fn practise(
        &self,
        learner: &dyn Practise,
        trial: &Trial,
        monitor: &mut dyn Monitor,
    ) -> Result<Practised, TrainError> {
        learner.practise(
            &Practice {
                simulator: self.simulator.as_ref(),
                tasks: &TaskDistribution::default(),
                initial_states: &InitialStates { max_random_steps: 5, ..InitialStates::default() },
                set_size: trial.set_size,
                horizon: Horizon { steps: STEPS, discount: 1.0, stop_at_fall: true },
                demonstrations: &trial.demonstrations,
                seed: Seed::root(trial.seed),
            },
            monitor,
        )
    }

    fn granted(&self, what: &str, learner: &dyn Practise, trial: &Trial) -> Result<Practised, Violation> {
        granted(what, self.practise(learner, trial, &mut Stopwatch::never()))
    }
}

fn practising(learner: &dyn OptionLearner) -> Result<&dyn Practise, Violation> {
    match learner.way() {
        Way::Practises(learner) => Ok(learner),
        Way::Imitates(_) | Way::Apprentices(_) => {
            Err(Violation::new("the learner's way", "practising", "another"))
        }
    }
}

impl Interruptible for Case {
    type Outcome = Practised;

    fn run(&self, monitor: &mut dyn Monitor) -> Result<Practised, TrainError> {
        let other = |violation: Violation| TrainError::Other(violation.to_string());
        let learner = practising(self.learner.as_ref()).map_err(other)?;
        self.practise(learner, &self.trial().map_err(other)?, monitor)
    }

    fn kept(&self) -> &OnceLock<Result<Watched<Practised>, TrainError>> {
        &self.practised
    }

    fn same(expected: &Practised, got: &Practised) -> Result<(), Violation> {
        same_size(expected.options.len(), got)?;
        for (ours, theirs) in expected.options.iter().zip(&got.options) {
            same_option(ours.as_ref(), theirs.as_ref())?;
        }
        let curve = |practised: &Practised| format!("{:?}", practised.curve);
        if curve(expected) == curve(got) {
            return Ok(());
        }
        Err(Violation::new("learning curve", curve(expected), curve(got)))
    }
}

fn same_size(expected: usize, got: &Practised) -> Result<(), Violation> {
    match got.options.len() {
        count if count == expected => Ok(()),
        count => Err(Violation::new("options of the set", expected, count)),
    }
}

/// Asks that two sets are not the same.
fn differ(what: &str, one: &Practised, other: &Practised) -> Result<(), Violation> {
    match Case::same(one, other) {
        Err(_) => Ok(()),
        Ok(()) => Err(Violation::new(what, "another set", "the same set")),
    }
}

const CONFIG_SURVIVES_FILES: Check<Case> = Check {
    name: "config_survives_files",
    rule: "Written as JSON or TOML and read back, the config learns the same set, bit for bit.",
    run: |case| {
        let expected = &case.watched()?.outcome;
        for copy in round_trip(case.learner.as_ref())? {
            let learner = practising(copy.as_ref())?;
            Case::same(expected, &case.granted("practice with the copy", learner, &case.trial()?)?)?;
        }
        Ok(())
    },
};

const PRACTICE_REPEATS: Check<Case> = Check {
    name: "practice_repeats",
    rule: "The same practice gives the same set and curve, bit for bit, also on another thread.",
    run: repeats,
};

const THREADS_CHANGE_NOTHING: Check<Case> = Check {
    name: "threads_change_nothing",
    rule: "However many threads it may use, practice gives the same set and curve, bit for bit.",
    run: threads_change_nothing,
};

const SEEDS_MATTER: Check<Case> = Check {
    name: "seeds_matter",
    rule: "Another seed gives another set, so that several can be learned to choose from.",
    run: |case| {
        let trial = Trial { seed: 2, ..case.trial()? };
        let other = case.granted("practice with another seed", practising(case.learner.as_ref())?, &trial)?;
        Ok(differ("practice with another seed", &case.watched()?.outcome, &other)?)
    },
};

const SETS_HAVE_THE_SIZE_ASKED_FOR: Check<Case> = Check {
    name: "sets_have_the_size_asked_for",
    rule: "A set has as many options as the practice asks for, one or three, also where fewer recordings are left.",
    run: |case| {
        for set_size in [1, 3] {
            let mut trial = Trial { set_size, ..case.trial()? };
            trial.demonstrations.truncate(1);
            let learner = practising(case.learner.as_ref())?;
            same_size(set_size, &case.granted(&format!("a set of {set_size}"), learner, &trial)?)?;
        }
        Ok(())
    },
};

const LEARNED_OPTIONS_CONFORM: Check<Case> = Check {
    name: "learned_options_conform",
    rule: "What is learned names a known format and keeps every rule of option policies.",
    run: |case| {
        let learned = case.granted("practice", practising(case.learner.as_ref())?, &case.trial()?)?;
        learned.options.into_iter().try_for_each(|option| Ok(case.conforms(option)?))
    },
};

const STOPS_ARE_OBEYED: Check<Case> = Check {
    name: "stops_are_obeyed",
    rule: "Practice ends as stopped when the monitor says so, at its first report of progress and at its first \
           checkpoint.",
    run: obeys_stops,
};

const PRACTICE_RESUMES_WITH_THE_SAME_BYTES: Check<Case> = Check {
    name: "practice_resumes_with_the_same_bytes",
    rule: "Stopped at each of its checkpoints in turn, or between two, and taken up again from the last, practice gives \
           what it gives uninterrupted, bit for bit.",
    run: resumes,
};

const DAMAGED_CHECKPOINTS_CHANGE_NOTHING: Check<Case> = Check {
    name: "damaged_checkpoints_change_nothing",
    rule: "A checkpoint that was cut short or is not one at all is an error, or practice starts anew; it never panics and \
           never gives another set.",
    run: survives_damage,
};

const CURVES_GO_FORWARD: Check<Case> = Check {
    name: "curves_go_forward",
    rule: "The steps of the learning curve grow, and what it reports is finite.",
    run: |case| goes_forward(&case.watched()?.outcome.curve),
};

const PROGRESS_IS_HONEST: Check<Case> = Check {
    name: "progress_is_honest",
    rule: "Progress is reported, never goes back, and its total is the config's own estimate of simulator steps.",
    run: |case| {
        let estimate = practising(case.learner.as_ref())?.simulator_steps();
        tells_progress(&case.watched()?.progress, estimate)
    },
};

const RECORDINGS_ARE_BEGUN_FROM: Check<Case> = Check {
    name: "recordings_are_begun_from",
    rule: "Where the config says that sets begin from recordings, other recordings give another set.",
    run: |case| {
        let learner = practising(case.learner.as_ref())?;
        if !learner.begins_from_recordings() {
            return Err(Finding::Skipped("it begins from no recordings".to_owned()));
        }
        let trial = Trial { demonstrations: vec![demonstration(&case.spec()?, 9)], ..case.trial()? };
        let other = case.granted("practice from other recordings", learner, &trial)?;
        Ok(differ("practice from other recordings", &case.watched()?.outcome, &other)?)
    },
};

const MALFORMED_DEMONSTRATIONS_ARE_REFUSED: Check<Case> = Check {
    name: "malformed_demonstrations_are_refused",
    rule: "Where sets begin from recordings, one of no steps, of other lengths than its steps ask for, or with numbers \
           that are not finite is an error.",
    run: |case| {
        let learner = practising(case.learner.as_ref())?;
        if !learner.begins_from_recordings() {
            return Err(Finding::Skipped("it begins from no recordings".to_owned()));
        }
        for (what, wrong) in malformed(&case.spec()?) {
            let trial = Trial { demonstrations: vec![wrong], ..case.trial()? };
            let practised = case.practise(learner, &trial, &mut Stopwatch::never());
            refused(format!("practice from {what}"), practised)?;
        }
        Ok(())
    },
};

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering};

    use rand::RngExt as _;
    use serde::{Deserialize, Serialize};

    use super::*;
    use crate::conformance::liars::{Lie, demand_that_liars_are_caught};
    use crate::conformance::option_learner::{run, well_formed};
    use crate::conformance::option_policy::liars::{HONEST, Script};
    use crate::conformance::point_mass::PointMassConfig;
    use crate::fault::Faults;
    use crate::policy::{CurvePoint, OptionPolicy};
    use crate::spec::SimulatorSpec;

    const ROUNDS: u64 = 6;

    /// Lets the forces of its options drift, six times over, but for one lie.
    #[derive(Debug, Serialize, Deserialize)]
    struct Drifter {
        lie: String,
        #[serde(skip)]
        forgotten: f32,
        #[serde(skip)]
        practices: AtomicU32,
    }

    /// What a checkpoint holds, as JSON.
    #[derive(Serialize, Deserialize)]
    struct Drift {
        round: u64,
        forces: Vec<f32>,
        curve: Vec<CurvePoint>,
    }

    impl Drifter {
        fn is(&self, lie: &str) -> bool {
            self.lie == lie
        }

        /// Where forces begin: at the first actions of the recordings.
        fn begin(&self, practice: &Practice<'_>, spec: &SimulatorSpec) -> Result<Drift, TrainError> {
            let size = spec.action_size();
            let mut forces = vec![0.0; practice.set_size * size];
            for (force, recording) in forces.chunks_mut(size).zip(practice.demonstrations) {
                let right = well_formed(recording, spec);
                if !right && !self.is("malformed_demonstrations_are_refused") {
                    return Err(TrainError::Other("a recording is malformed".to_owned()));
                }
                if right && !self.is("recordings_are_begun_from") {
                    force.copy_from_slice(&recording.actions[..size]);
                }
            }
            Ok(Drift { round: 0, forces, curve: Vec::new() })
        }

        fn taken_up(&self, checkpoint: &[u8], fresh: Drift) -> Result<Drift, TrainError> {
            match serde_json::from_slice::<Drift>(checkpoint) {
                Ok(drift) if self.is("practice_resumes_with_the_same_bytes") => {
                    Ok(Drift { forces: fresh.forces, ..drift })
                }
                Ok(drift) => Ok(drift),
                Err(_) if self.is("damaged_checkpoints_change_nothing") => {
                    Ok(Drift { round: ROUNDS - 1, ..fresh })
                }
                Err(error) => Err(TrainError::Other(error.to_string())),
            }
        }

        fn seed(&self, practice: &Practice<'_>) -> Seed {
            let before = self.practices.fetch_add(1, Ordering::Relaxed);
            match self.lie.as_str() {
                "practice_repeats" => practice.seed.index(u64::from(before)),
                "config_survives_files" => practice.seed.child(&self.forgotten.to_string()),
                "seeds_matter" => Seed::root(0),
                _ => practice.seed.clone(),
            }
        }
    }

    #[typetag::serde(name = "drifter")]
    impl OptionLearner for Drifter {
        fn validate(&self, faults: &mut Faults) {
            faults.check(!self.is("config_is_valid"), "lie", || "expected the truth".to_owned());
        }

        fn way(&self) -> Way<'_> {
            Way::Practises(self)
        }
    }

    impl Practise for Drifter {
        fn simulator_steps(&self) -> u64 {
            ROUNDS * STEPS as u64
        }

        fn begins_from_recordings(&self) -> bool {
            true
        }

        fn practise(
            &self,
            practice: &Practice<'_>,
            monitor: &mut dyn Monitor,
        ) -> Result<Practised, TrainError> {
            let spec = practice.simulator.spec()?;
            let size = spec.action_size();
            let seed = self.seed(practice);
            let mut drift = self.begin(practice, &spec)?;
            if self.is("threads_change_nothing") {
                drift.forces[0] += monitor.threads() as f32;
            }
            if let Some(bytes) = monitor.resume() {
                drift = self.taken_up(&bytes, drift)?;
            }
            while drift.round < ROUNDS {
                let mut stream = seed.index(drift.round).stream();
                drift.forces.iter_mut().for_each(|force| *force += 0.1 * stream.random::<f32>());
                drift.round += 1;
                let done = drift.round * STEPS as u64;
                let steps = if self.is("curves_go_forward") { 1 } else { done };
                drift.curve.push(CurvePoint { steps, mean_return: Some(1.0), mean_length: None });
                let told = if self.is("progress_is_honest") { done + 1 } else { done };
                let go_on = monitor.progress(told, self.simulator_steps());
                if !self.is("stops_are_obeyed") || drift.round > 1 {
                    go_on?;
                }
                if drift.round.is_multiple_of(2) && drift.round < ROUNDS {
                    let bytes = serde_json::to_vec(&drift).map_err(|e| TrainError::Other(e.to_string()))?;
                    monitor.checkpoint(&bytes)?;
                }
            }
            if self.is("sets_have_the_size_asked_for") {
                drift.forces.resize(2 * size, 0.0);
            }
            let lie = if self.is("learned_options_conform") { "interest_is_positive" } else { "none" };
            let option =
                |row: &[f32]| Box::new(Script::new(vec![row.to_vec()], lie)) as Box<dyn OptionPolicy>;
            Ok(Practised { options: drift.forces.chunks(size).map(option).collect(), curve: drift.curve })
        }
    }

    fn case(lie: &str) -> Case {
        let drifter = Drifter { lie: lie.to_owned(), forgotten: 1.0, practices: AtomicU32::new(0) };
        Case::new(Box::new(drifter), Box::new(PointMassConfig::default()), vec![HONEST])
    }

    #[test]
    fn an_honest_learner_keeps_every_rule() {
        let report = run(&case("none"));
        assert!(report.failed().is_empty() && report.skipped().is_empty(), "{report}");
    }

    #[test]
    fn each_liar_is_caught_by_the_check_that_is_meant_for_it() {
        let also = |name: &str| -> &'static [&'static str] {
            if name == PRACTICE_REPEATS.name {
                &["threads_change_nothing", "practice_resumes_with_the_same_bytes"]
            } else {
                &[]
            }
        };
        let lies: Vec<Lie<Box<Case>>> = CHECKS
            .iter()
            .map(|check| Lie {
                caught_by: check.name,
                also: also(check.name),
                subject: Box::new(case(check.name)),
            })
            .collect();
        demand_that_liars_are_caught(CHECKS, &lies);
    }
}
