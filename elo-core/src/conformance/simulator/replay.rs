//! A trajectory is a function of task, start and actions, and of nothing that happened before.

use super::mistake::MISTAKES;
use super::task::{extremes, varied};
use super::trace::{Episode, Trace, begin};
use super::{Case, Check, Finding, Violation};
use crate::simulator::{End, Start};
use crate::spec::SimulatorSpec;
use crate::task::Task;

pub(super) const FRESH_OBJECTS_REPEAT: Check<Case> = Check {
    name: "fresh_objects_repeat",
    rule: "Three objects built from one config give the same episode, bit for bit.",
    run: |case| {
        let episode = Episode::random(case.simulator()?.spec(), 1, case.steps);
        let expected = episode.play(case.simulator()?.as_mut())?;
        for _ in 0..2 {
            expected.same(&episode.play(case.simulator()?.as_mut())?)?;
        }
        Ok(())
    },
};

pub(super) const A_USED_OBJECT_REPEATS: Check<Case> = Check {
    name: "a_used_object_repeats",
    rule: "One object gives the same episode again and again, bit for bit, also when it was left in its middle.",
    run: |case| {
        let mut simulator = case.simulator()?;
        let episode = Episode::random(simulator.spec(), 1, case.steps);
        let expected = episode.play(simulator.as_mut())?;
        for left_after in [case.steps, case.steps / 2, 0] {
            let part = Episode { actions: episode.actions[..left_after].to_vec(), ..episode.clone() };
            part.play(simulator.as_mut())?;
            let again = episode.play(simulator.as_mut())?;
            expected.same(&again).map_err(|v| v.during(format!("after {left_after} steps of it")))?;
        }
        Ok(())
    },
};

pub(super) const THE_ORDER_OF_EPISODES_IS_IMMATERIAL: Check<Case> = Check {
    name: "the_order_of_episodes_is_immaterial",
    rule: "Episodes of other seeds, tasks and lengths, before it, change no bit of an episode.",
    run: |case| {
        let mut used = case.simulator()?;
        let episodes = varied_episodes(used.spec(), case.steps);
        let expected = episodes
            .iter()
            .map(|episode| Ok(episode.play(case.simulator()?.as_mut())?))
            .collect::<Result<Vec<Trace>, Finding>>()?;
        let last = episodes.len() - 1;
        let orders: [Vec<usize>; 3] = [
            (0..=last).collect(),
            (0..=last).rev().collect(),
            (0..=last).flat_map(|i| [i, 0, last - i]).collect(),
        ];
        for (i, previous) in orders.iter().flatten().zip(std::iter::once(&0).chain(orders.iter().flatten())) {
            let again = episodes[*i].play(used.as_mut())?;
            expected[*i].same(&again).map_err(|v| v.during(format!("episode {i} after {previous}")))?;
        }
        Ok(())
    },
};

pub(super) const AN_ERROR_LEAVES_NOTHING: Check<Case> = Check {
    name: "an_error_leaves_nothing",
    rule: "After each kind of refusal the next reset gives the same episode, bit for bit.",
    run: |case| {
        let mut simulator = case.simulator()?;
        let episode = Episode::random(simulator.spec(), 1, case.steps);
        let expected = episode.play(case.simulator()?.as_mut())?;
        for mistake in MISTAKES {
            let part = Episode { actions: episode.actions[..2].to_vec(), ..episode.clone() };
            part.play(simulator.as_mut())?;
            let _refused_or_not = (mistake.make)(simulator.as_mut());
            let again = episode.play(simulator.as_mut()).map_err(|v| v.during(mistake.name))?;
            expected.same(&again).map_err(|v| v.during(mistake.name))?;
        }
        Ok(())
    },
};

pub(super) const ANOTHER_THREAD_REPEATS: Check<Case> = Check {
    name: "another_thread_repeats",
    rule: "An object gives the same episode, bit for bit, on another thread, built there or moved there.",
    run: |case| {
        let mut moved = case.simulator()?;
        let episode = Episode::random(moved.spec(), 1, case.steps);
        let expected = episode.play(moved.as_mut())?;
        let (there, built_there) = std::thread::scope(|scope| {
            let work = || {
                let there = episode.play(moved.as_mut());
                (there, case.simulator().and_then(|mut built| Ok(episode.play(built.as_mut())?)))
            };
            scope.spawn(work).join().map_err(|_| Violation::new("the other thread", "no panic", "a panic"))
        })?;
        expected.same(&there?).map_err(|v| v.during("moved there"))?;
        expected.same(&built_there?).map_err(|v| v.during("built there"))?;
        Ok(())
    },
};

pub(super) const SEEDS_CHOOSE_THE_START: Check<Case> = Check {
    name: "seeds_choose_the_start",
    rule: "Eight seeds do not all give the same first observation.",
    run: |case| {
        let mut simulator = case.simulator()?;
        let mut start = |seed| begin(simulator.as_mut(), &Task::default(), &Start::Seed(seed));
        let first = start(0)?;
        for seed in 1..8 {
            if start(seed)? != first {
                return Ok(());
            }
        }
        Err(Violation::new("starts of seeds 0 to 7", "some that differ", format!("only {first:?}")).into())
    },
};

pub(super) const EVERY_SEED_IS_ACCEPTED: Check<Case> = Check {
    name: "every_seed_is_accepted",
    rule: "Each number of 64 bits is a seed.",
    run: |case| {
        let mut simulator = case.simulator()?;
        for seed in [0, u64::from(u32::MAX) + 1, 1 << 53, 1 << 63, u64::MAX] {
            let start = Start::Seed(seed);
            begin(simulator.as_mut(), &Task::default(), &start)
                .map_err(|v| v.during(format!("seed {seed}")))?;
        }
        Ok(())
    },
};

/// A digest of every bit that a fixed set of episodes gives, as 64 hexadecimal digits: equal in every process, run and
/// order of work of one program on one kind of machine, and elsewhere where the engine promises it.
///
/// # Errors
/// A violation or a reason to skip, as checks give them.
pub fn fingerprint(case: &Case) -> Result<String, Finding> {
    let mut simulator = case.simulator()?;
    let mut hasher = blake3::Hasher::new();
    for episode in varied_episodes(simulator.spec(), case.steps) {
        hash(&episode.play(simulator.as_mut())?, &mut hasher);
    }
    Ok(hasher.finalize().to_string())
}

fn hash(trace: &Trace, hasher: &mut blake3::Hasher) {
    for x in &trace.first {
        hasher.update(&x.to_le_bytes());
    }
    for moment in &trace.moments {
        for x in &moment.observation {
            hasher.update(&x.to_le_bytes());
        }
        for x in &moment.terms {
            hasher.update(&x.to_le_bytes());
        }
        hasher.update(&[match moment.end {
            End::Running => 0,
            End::Terminated => 1,
            End::Truncated => 2,
        }]);
    }
}

/// The default task and each extreme of each task parameter, with seeds and lengths that differ.
fn varied_episodes(spec: &SimulatorSpec, steps: usize) -> Vec<Episode> {
    let tasks = std::iter::once(Task::default()).chain(extremes(spec)).chain([varied(spec)]);
    tasks
        .enumerate()
        .map(|(i, task)| Episode::random(spec, i as u64, steps - (i % 3) * (steps / 4)).in_task(task))
        .collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::conformance::point_mass::PointMassConfig;

    fn case(wall: f64) -> Case {
        Case::new(Box::new(PointMassConfig { wall, ..PointMassConfig::default() }))
    }

    #[test]
    fn fingerprints_tell_worlds_apart_and_nothing_else() {
        let print = fingerprint(&case(2.0)).unwrap();
        assert_eq!(print.len(), 64);
        assert_eq!(fingerprint(&case(2.0)).unwrap(), print);
        assert_ne!(fingerprint(&case(0.11)).unwrap(), print);
    }
}
