//! A training depends on nothing but its lesson, however often it is interrupted.

use super::{Case, Check, Finding, Stop, Stopwatch, Violation, digest, same_text, same_training};
use crate::conformance::compare::granted;
use crate::policy::{Stopped, TrainError, Trained};

pub(super) const TRAINING_REPEATS: Check<Case> = Check {
    name: "training_repeats",
    rule: "The same lesson gives the same policy, snapshots and curve, bit for bit, also on another thread.",
    run: |case| {
        let expected = &case.watched()?.trained;
        let there = std::thread::scope(|scope| {
            scope.spawn(|| case.train(case.teacher.as_ref(), &mut Stopwatch::never())).join()
        });
        let there = there.map_err(|_| Violation::new("the other thread", "no panic", "a panic"))?;
        Ok(same_training(expected, &granted("training on another thread", there)?)?)
    },
};

pub(super) const STOPS_ARE_OBEYED: Check<Case> = Check {
    name: "stops_are_obeyed",
    rule: "Training ends as stopped when the monitor says so, at its first report of progress and at its first \
           checkpoint.",
    run: |case| {
        let watched = case.watched()?;
        let mut stops = vec![Stop::AtProgress(1)];
        stops.extend((watched.checkpoints > 0).then_some(Stop::AtCheckpoint(1)));
        for stop in stops {
            match case.train(case.teacher.as_ref(), &mut Stopwatch::stopping(stop)) {
                Err(TrainError::Stopped(Stopped)) => {}
                Err(error) => return Err(Violation::new(format!("{stop:?}"), Stopped, error).into()),
                Ok(_) => return Err(Violation::new(format!("{stop:?}"), Stopped, "a teacher").into()),
            }
        }
        Ok(())
    },
};

pub(super) const TRAINING_RESUMES_WITH_THE_SAME_BYTES: Check<Case> = Check {
    name: "training_resumes_with_the_same_bytes",
    rule: "Stopped at each of its checkpoints in turn, or between two, and taken up again from the last, training \
           gives what it gives uninterrupted, bit for bit.",
    run: |case| {
        let watched = case.watched()?;
        if watched.checkpoints == 0 {
            return Err(Finding::Skipped("it writes no checkpoints".to_owned()));
        }
        let chained = with_stops(case, watched.checkpoints)?;
        same_training(&watched.trained, &chained).map_err(|v| v.during("stopped at every checkpoint"))?;
        for moment in [watched.progress.len() / 2, watched.progress.len()] {
            let mut broken = Stopwatch::stopping(Stop::AtProgress(moment.max(1)));
            if case.train(case.teacher.as_ref(), &mut broken).is_ok() {
                return Err(
                    Violation::new(format!("report of progress {moment}"), Stopped, "a teacher").into()
                );
            }
            let mut rest = Stopwatch::from(broken.checkpoints.pop(), Stop::Never);
            let trained = granted("training taken up again", case.train(case.teacher.as_ref(), &mut rest))?;
            same_training(&watched.trained, &trained)
                .map_err(|v| v.during(format!("stopped at report of progress {moment}")))?;
        }
        Ok(())
    },
};

pub(super) const DAMAGED_CHECKPOINTS_CHANGE_NOTHING: Check<Case> = Check {
    name: "damaged_checkpoints_change_nothing",
    rule: "A checkpoint that was cut short or is not one at all is an error, or training starts anew; it never panics \
           and never gives another teacher.",
    run: |case| {
        let watched = case.watched()?;
        if watched.checkpoints == 0 {
            return Err(Finding::Skipped("it writes no checkpoints".to_owned()));
        }
        let mut first = Stopwatch::stopping(Stop::AtCheckpoint(1));
        let _stopped = case.train(case.teacher.as_ref(), &mut first);
        let whole = first.checkpoints.pop().unwrap_or_default();
        let cut = |length: usize| whole[..length].to_vec();
        let damaged = [
            ("an empty one", Vec::new()),
            ("half of one", cut(whole.len() / 2)),
            ("one without its last byte", cut(whole.len().saturating_sub(1))),
            ("one of other bytes", vec![0xa5; whole.len()]),
        ];
        for (what, bytes) in damaged {
            let mut monitor = Stopwatch::from(Some(bytes), Stop::Never);
            if let Ok(trained) = case.train(case.teacher.as_ref(), &mut monitor) {
                same_training(&watched.trained, &trained).map_err(|v| v.during(what))?;
            }
        }
        Ok(())
    },
};

pub(super) const SNAPSHOTS_LEAD_TO_THE_POLICY: Check<Case> = Check {
    name: "snapshots_lead_to_the_policy",
    rule: "There are snapshots, their steps grow, and the last is the trained policy.",
    run: |case| {
        let trained = &case.watched()?.trained;
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
    run: |case| {
        let curve = &case.watched()?.trained.curve;
        growing("steps of the curve", curve.iter().map(|point| point.steps))?;
        let numbers = curve.iter().flat_map(|p| [p.mean_return, p.mean_length]).flatten();
        match numbers.into_iter().find(|x| !x.is_finite()) {
            None => Ok(()),
            Some(x) => Err(Violation::new("a number of the curve", "finite", x).into()),
        }
    },
};

pub(super) const PROGRESS_IS_HONEST: Check<Case> = Check {
    name: "progress_is_honest",
    rule: "Progress is reported, never goes back, and its total is the config's own estimate of simulator steps.",
    run: |case| {
        let progress = &case.watched()?.progress;
        let estimate = case.teacher.simulator_steps();
        let mut before = 0;
        for (done, total) in progress {
            if *total != estimate {
                return Err(Violation::new("total of the progress", estimate, total).into());
            }
            if !(before..=estimate).contains(done) {
                let expected = format!("{before} to {estimate}");
                return Err(Violation::new("steps done", expected, done).into());
            }
            before = *done;
        }
        if progress.is_empty() {
            return Err(Violation::new("reports of progress", "one or more", 0).into());
        }
        Ok(())
    },
};

/// Trains to the end, stopping at each checkpoint and taking up again from it.
fn with_stops(case: &Case, checkpoints: usize) -> Result<Trained, Finding> {
    let mut newest = None;
    for _ in 0..=checkpoints {
        let mut monitor = Stopwatch::from(newest.take(), Stop::AtCheckpoint(1));
        match case.train(case.teacher.as_ref(), &mut monitor) {
            Ok(trained) => return Ok(trained),
            Err(TrainError::Stopped(Stopped)) => newest = monitor.checkpoints.pop(),
            Err(error) => return Err(Violation::new("training taken up again", "a teacher", error).into()),
        }
    }
    let (expected, got) = (format!("an end after {checkpoints} checkpoints"), "one more checkpoint");
    Err(Violation::new("training taken up again", expected, got).into())
}

fn growing(what: &str, steps: impl Iterator<Item = u64>) -> Result<(), Violation> {
    let mut before = None;
    for step in steps {
        if before.is_some_and(|before| step <= before) {
            return Err(Violation::new(what, format!("more than {}", before.unwrap_or(0)), step));
        }
        before = Some(step);
    }
    Ok(())
}
