//! A training depends on nothing but its lesson, however often it is interrupted.

use super::{Case, Check, Violation, digest, same_text};
use crate::conformance::interruptible::{
    Interruptible as _, goes_forward, growing, obeys_stops, repeats, resumes, survives_damage,
    tells_progress, threads_change_nothing,
};

pub(super) const TRAINING_REPEATS: Check<Case> = Check {
    name: "training_repeats",
    rule: "The same lesson gives the same policy, snapshots and curve, bit for bit, also on another thread.",
    run: repeats,
};

pub(super) const THREADS_CHANGE_NOTHING: Check<Case> = Check {
    name: "threads_change_nothing",
    rule: "However many threads it may use, training gives the same policy, snapshots and curve, bit for bit.",
    run: threads_change_nothing,
};

pub(super) const STOPS_ARE_OBEYED: Check<Case> = Check {
    name: "stops_are_obeyed",
    rule: "Training ends as stopped when the monitor says so, at its first report of progress and at its first \
           checkpoint.",
    run: obeys_stops,
};

pub(super) const TRAINING_RESUMES_WITH_THE_SAME_BYTES: Check<Case> = Check {
    name: "training_resumes_with_the_same_bytes",
    rule: "Stopped at each of its checkpoints in turn, or between two, and taken up again from the last, training \
           gives what it gives uninterrupted, bit for bit.",
    run: resumes,
};

pub(super) const DAMAGED_CHECKPOINTS_CHANGE_NOTHING: Check<Case> = Check {
    name: "damaged_checkpoints_change_nothing",
    rule: "A checkpoint that was cut short or is not one at all is an error, or training starts anew; it never panics \
           and never gives another teacher.",
    run: survives_damage,
};

pub(super) const SNAPSHOTS_LEAD_TO_THE_POLICY: Check<Case> = Check {
    name: "snapshots_lead_to_the_policy",
    rule: "There are snapshots, their steps grow, and the last is the trained policy.",
    run: |case| {
        let trained = &case.watched()?.outcome;
        growing("steps of the snapshots", trained.snapshots.iter().map(|snapshot| snapshot.steps))?;
        match trained.snapshots.last() {
            None => Err(Violation::new("snapshots", "one or more", 0).into()),
            Some(last) => {
                Ok(same_text("digest of the last", &digest(&trained.policy), &digest(&last.policy))?)
            }
        }
    },
};

pub(super) const CURVES_GO_FORWARD: Check<Case> = Check {
    name: "curves_go_forward",
    rule: "The steps of the learning curve grow, and what it reports is finite.",
    run: |case| goes_forward(&case.watched()?.outcome.curve),
};

pub(super) const PROGRESS_IS_HONEST: Check<Case> = Check {
    name: "progress_is_honest",
    rule: "Progress is reported, never goes back, and its total is the config's own estimate of simulator steps.",
    run: |case| tells_progress(&case.watched()?.progress, case.teacher.simulator_steps()),
};
