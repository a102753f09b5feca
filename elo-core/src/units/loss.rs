//! What becomes of a unit over which workers are lost.
//!
//! A unit of many rollouts is not given up for the sake of one. Once a worker was lost over it, it keeps what it has done
//! in a checkpoint after each rollout, so that the next worker goes on behind that. The rollout at which [`TRIES`] workers
//! in a row are lost is recorded as failed, and the others are what they would have been, because each draws from a stream
//! of its own; only where one option or agent fails so everywhere, the rest of its rollouts is not tried. A unit that never loses a worker keeps nothing.

use super::WorkError;
use super::codec::{self, Malformed};
use crate::policy::{Monitor, Stopped};
use crate::workforce::TRIES;

/// What is to be done after a worker was lost.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum AfterLoss {
    /// Another worker takes the unit up from this checkpoint.
    TakeUp(Vec<u8>),
    /// This is the unit's result.
    Result(Vec<u8>),
}

/// A stage whose units are done piece by piece.
pub(super) trait Piecewise {
    /// The pieces that are done.
    type Done;

    /// None.
    fn begin(&self, inputs: &[Vec<u8>]) -> Result<Self::Done, WorkError>;

    /// What is done as bytes, to be kept.
    fn to_bytes(done: &Self::Done) -> Vec<u8>;

    /// Reads them.
    fn from_bytes(bytes: &[u8]) -> Result<Self::Done, Malformed>;

    /// The unit's result, if nothing is left to do.
    fn result(&self, done: &Self::Done) -> Option<Vec<u8>>;

    /// Records the next piece as failed.
    fn give_up_next(&self, done: &mut Self::Done, reason: &str) -> Result<(), WorkError>;

    /// What earlier workers have done, and whether a worker was lost over the unit: then it is to be [kept](keep).
    fn take_up(
        &self,
        inputs: &[Vec<u8>],
        monitor: &mut dyn Monitor,
    ) -> Result<(Self::Done, bool), WorkError> {
        match monitor.resume() {
            Some(bytes) => Ok((Self::from_bytes(&Kept::decode(&bytes)?.done)?, true)),
            None => Ok((self.begin(inputs)?, false)),
        }
    }

    /// Keeps what is done for the next worker.
    fn keep(done: &Self::Done, monitor: &mut dyn Monitor) -> Result<(), Stopped> {
        monitor.checkpoint(&Kept::new(Self::to_bytes(done)).encode())
    }

    /// See [`Work::after_loss`](super::Work::after_loss).
    fn after_loss(
        &self,
        inputs: &[Vec<u8>],
        kept: Option<&[u8]>,
        reason: &str,
    ) -> Result<AfterLoss, WorkError> {
        let Some(kept) = kept else {
            let nothing = Self::to_bytes(&self.begin(inputs)?);
            return Ok(AfterLoss::TakeUp(Kept::new(nothing).encode()));
        };
        let mut kept = Kept::decode(kept)?;
        let mut done = Self::from_bytes(&kept.done)?;
        kept.losses += 1;
        if kept.losses == TRIES && self.result(&done).is_none() {
            self.give_up_next(&mut done, reason)?;
            kept = Kept::new(Self::to_bytes(&done));
        }
        Ok(self.result(&done).map_or_else(|| AfterLoss::TakeUp(kept.encode()), AfterLoss::Result))
    }
}

/// The checkpoint of a unit that keeps what it has done.
struct Kept {
    /// Workers that were lost since.
    losses: usize,
    /// What is done.
    done: Vec<u8>,
}

impl Kept {
    fn new(done: Vec<u8>) -> Self {
        Self { losses: 0, done }
    }

    fn encode(&self) -> Vec<u8> {
        codec::encode(&self.losses, &[&self.done])
    }

    fn decode(bytes: &[u8]) -> Result<Self, Malformed> {
        let (losses, sections) = codec::decode(bytes)?;
        let [done] = sections[..] else {
            return Err(Malformed(format!("a checkpoint of {} sections", sections.len())));
        };
        Ok(Self { losses, done: done.to_vec() })
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use std::collections::BTreeMap;

    use super::*;
    use crate::conformance::point_mass::PointMassConfig;
    use crate::context::{Context, InitialStates, PreparedStart};
    use crate::experiment::TeacherActs;
    use crate::policy::Trained;
    use crate::rollout::{Ending, Horizon};
    use crate::seed::Seed;
    use crate::task::Task;
    use crate::tensors::Tensors;
    use crate::units::evaluate::{Behavior, Evaluate, RolloutTable, Subject};
    use crate::units::play::Play;
    use crate::units::record::{self, Record};
    use crate::units::train::TeacherResult;
    use crate::units::train::tests::SteadyConfig;
    use crate::units::{Site, Span, Work, prepare};

    /// Workers, so many of which die when they come to a piece, and the one checkpoint of their unit.
    #[derive(Default)]
    struct Mortals {
        dying_at: BTreeMap<u64, usize>,
        died: usize,
        kept: Option<Vec<u8>>,
        checkpoints: usize,
    }

    impl Monitor for Mortals {
        fn resume(&mut self) -> Option<Vec<u8>> {
            self.kept.clone()
        }

        fn checkpoint(&mut self, bytes: &[u8]) -> Result<(), Stopped> {
            self.checkpoints += 1;
            self.kept = Some(bytes.to_vec());
            Ok(())
        }

        fn progress(&mut self, done: u64, _: u64) -> Result<(), Stopped> {
            match self.dying_at.get_mut(&done) {
                Some(left) if *left > 0 => {
                    *left -= 1;
                    self.died += 1;
                    Err(Stopped)
                }
                _ => Ok(()),
            }
        }
    }

    /// Has the unit done as a crew does, and tells with what result and which losses.
    fn done(work: &Work, inputs: &[Vec<u8>], dying_at: &[(u64, usize)]) -> (Vec<u8>, Mortals) {
        let (done, workers) = tried(work, inputs, dying_at);
        (done.unwrap(), workers)
    }

    fn tried(
        work: &Work,
        inputs: &[Vec<u8>],
        dying_at: &[(u64, usize)],
    ) -> (Result<Vec<u8>, WorkError>, Mortals) {
        let mut workers = Mortals { dying_at: dying_at.iter().copied().collect(), ..Mortals::default() };
        loop {
            match work.perform(inputs, &mut Site::new(Vec::new()), &mut workers) {
                Err(WorkError::Stopped(_)) => {}
                done => return (done, workers),
            }
            match work.after_loss(inputs, workers.kept.as_deref(), "it died").map(Option::unwrap) {
                Ok(AfterLoss::TakeUp(kept)) => workers.kept = Some(kept),
                Ok(AfterLoss::Result(bytes)) => return (Ok(bytes), workers),
                Err(error) => return (Err(error), workers),
            }
        }
    }

    /// More than are ever asked.
    const ALL: usize = usize::MAX;

    /// Two subjects in three contexts.
    /// Two agents in so many contexts.
    fn rollouts(contexts: u64) -> (Work, Vec<Vec<u8>>) {
        let subject = |name: &str| Subject { name: name.to_owned(), behavior: Behavior::RandomTorque };
        let play = Play {
            simulator: Box::new(PointMassConfig::default()),
            subjects: vec![subject("one"), subject("other")],
            horizon: Horizon { steps: 5, discount: 0.9, stop_at_fall: true },
            seed: Seed::root(3),
        };
        let context = |seed| Context { task: Task::default(), start: PreparedStart::standard(seed) };
        let contexts = prepare::encode(&(1..=contexts).map(context).collect::<Vec<_>>());
        (Evaluate { contexts: 1, play }.into(), vec![contexts])
    }

    #[test]
    fn a_rollout_that_loses_every_worker_fails_alone() {
        let (work, inputs) = rollouts(3);
        let (sound, workers) = done(&work, &inputs, &[]);
        assert_eq!((workers.died, workers.checkpoints), (0, 0), "what loses no worker keeps nothing");
        let sound = RolloutTable::decode(&sound).unwrap().rollouts;
        // In the middle, beside each other, and at both ends.
        for failing in [vec![2], vec![3, 4], vec![0, 5], vec![0, 1, 2, 3, 4, 5]] {
            let dying_at: Vec<(u64, usize)> = failing.iter().map(|piece| (*piece, ALL)).collect();
            let (bytes, workers) = done(&work, &inputs, &dying_at);
            assert_eq!(workers.died, 1 + TRIES * failing.len(), "{failing:?}");
            let table = RolloutTable::decode(&bytes).unwrap();
            assert_eq!((table.contexts, table.rollouts.len()), (3, sound.len()));
            for (number, (rollout, sound)) in table.rollouts.iter().zip(&sound).enumerate() {
                if failing.contains(&(number as u64)) {
                    assert_eq!(rollout.ending, Ending::Failed("it died".to_owned()), "{number}");
                    assert_eq!(rollout.term_sums, vec![0.0; sound.term_sums.len()]);
                } else {
                    assert_eq!(rollout, sound, "{number} beside {failing:?}");
                }
            }
        }
    }

    #[test]
    fn who_fails_everywhere_is_not_tried_to_the_end() {
        let (work, inputs) = rollouts(6);
        let (sound, _) = done(&work, &inputs, &[]);
        let sound = RolloutTable::decode(&sound).unwrap().rollouts;
        // The first agent from its second context on; the other would fail in its last two, which is not enough.
        let dying_at: Vec<(u64, usize)> = (1..6).chain(10..12).map(|piece| (piece, ALL)).collect();
        let (bytes, workers) = done(&work, &inputs, &dying_at);
        let table = RolloutTable::decode(&bytes).unwrap().rollouts;
        assert_eq!(workers.died, 1 + TRIES * (3 + 2));
        let lost = Ending::Failed("it died".to_owned());
        let not_tried =
            Ending::Failed("it died (so ended the last of 3 in a row; this one was not tried)".to_owned());
        let endings: Vec<&Ending> = table.iter().map(|rollout| &rollout.ending).collect();
        assert_eq!(endings[1..6], [&lost, &lost, &lost, &not_tried, &not_tried]);
        assert_eq!(endings[10..12], [&lost, &lost]);
        assert_eq!((&table[0], &table[6..10]), (&sound[0], &sound[6..10]));
    }

    #[test]
    fn workers_that_are_lost_now_and_then_change_no_byte() {
        for (work, inputs) in [rollouts(3), recordings()] {
            let (undisturbed, _) = done(&work, &inputs, &[]);
            let (bytes, workers) = done(&work, &inputs, &[(0, TRIES), (1, TRIES - 1), (3, TRIES - 1)]);
            assert_eq!(workers.died, 3 * TRIES - 2);
            assert_eq!(bytes, undisturbed);
        }
    }

    const MAX_RETAKES: u32 = 5;

    /// Four candidates.
    fn recordings() -> (Work, Vec<Vec<u8>>) {
        let work = Record {
            simulator: Box::new(PointMassConfig::default()),
            teacher: Box::new(SteadyConfig { action: 0.5 }),
            tasks: vec![Task::default()],
            initial_states: InitialStates { max_random_steps: 0, ..InitialStates::default() },
            acts: TeacherActs::Mean,
            horizon: Horizon { steps: 4, discount: 1.0, stop_at_fall: true },
            max_retakes: MAX_RETAKES,
            span: Span { first: 10, count: 4 },
            seed: Seed::root(5),
        };
        let trained = Trained { policy: Tensors::new(), snapshots: Vec::new(), curve: Vec::new() };
        let teacher = TeacherResult { trained: Some(trained), diverged: Vec::new() };
        (work.into(), vec![teacher.encode()])
    }

    #[test]
    fn a_take_that_loses_every_worker_is_followed_by_a_retake() {
        let (work, inputs) = recordings();
        let (sound, workers) = done(&work, &inputs, &[]);
        assert_eq!((workers.died, workers.checkpoints), (0, 0), "what loses no worker keeps nothing");
        let sound = record::decode(&sound).unwrap();
        assert!(sound.iter().all(|recording| recording.retakes == 0 && recording.demonstration.is_some()));

        let with = |dying: usize| {
            let (bytes, workers) = done(&work, &inputs, &[(2, dying)]);
            let recordings = record::decode(&bytes).unwrap();
            for other in [0, 1, 3] {
                assert_eq!(recordings[other], sound[other], "candidate {other} is not concerned");
            }
            (recordings[2].clone(), workers.died)
        };
        let died =
            |takes: std::ops::Range<u32>| takes.map(|take| (take, "it died".to_owned())).collect::<Vec<_>>();
        // The first loss tells only that the unit is to be done with care.
        let (retaken, _) = with(1 + TRIES);
        assert_eq!((retaken.retakes, &retaken.failures), (1, &died(0..1)));
        assert!(retaken.demonstration.is_some() && retaken.demonstration != sound[2].demonstration);
        let (given_up, lost) = with(ALL);
        let takes = TRIES as u32;
        assert_eq!((given_up.retakes, &given_up.failures), (takes - 1, &died(0..takes)), "no more than that");
        assert_eq!((given_up.demonstration, lost), (None, 1 + TRIES * TRIES));
        // Where the first ones are given up, all would be.
        let (ended, workers) = tried(&work, &inputs, &[(0, ALL), (1, ALL), (2, ALL)]);
        assert_eq!(ended, Err(WorkError::Failed("it died".to_owned())));
        assert_eq!(workers.died, 1 + TRIES * TRIES * TRIES);
    }
}
