//! Who is run in contexts, and which units' results it needs for that.

use crate::discover::{Candidate, duplicate};
use crate::experiment::TeacherActs;
use crate::key::Key;
use crate::policy::TeacherConfig;
use crate::seed::Seed;
use crate::units::evaluate::{Behavior, Place, Subject};

/// Somebody to be run in contexts: a name, and what it does with which units' results.
#[derive(Debug)]
pub struct Performer {
    /// Unique in the run.
    pub name: String,
    /// What it does.
    pub role: PerformerRole,
}

/// What a performer does.
#[derive(Debug)]
pub enum PerformerRole {
    /// Something that needs no other unit.
    Plain(fn() -> Behavior),
    /// An untrained teacher.
    Untrained {
        /// What makes it.
        teacher: Box<dyn TeacherConfig>,
        /// The root of its streams.
        seed: Seed,
        /// By its mean or by samples.
        acts: TeacherActs,
    },
    /// The teacher of a unit, or one of the policies kept on its way.
    Teacher {
        /// What reads it.
        teacher: Box<dyn TeacherConfig>,
        /// The unit.
        key: Key,
        /// Which of the kept policies; `None` for the trained one.
        snapshot: Option<usize>,
        /// By its mean or by samples.
        acts: TeacherActs,
    },
    /// The infant agent.
    Infant {
        /// The units that hold its options, and which of theirs.
        options: Vec<(Key, usize)>,
        /// Probability that a decision is one random primitive action.
        primitive_probability: f64,
    },
}

impl Performer {
    /// A candidate by itself.
    pub fn candidate(candidate: &Candidate) -> Self {
        Self::alone(candidate.number, candidate.options.clone())
    }

    /// The options of candidate `number` and nothing else: one again and again, or those of a set as the infant agent
    /// draws them.
    pub fn alone(number: usize, options: Vec<(Key, usize)>) -> Self {
        let kind = if options.len() == 1 { "option" } else { "set" };
        let role = PerformerRole::Infant { options, primitive_probability: 0.0 };
        Self { name: format!("{kind} {number}"), role }
    }

    /// What a unit is told of it; the units that it needs are added to the unit's `inputs`.
    pub(crate) fn subject(&self, inputs: &mut Vec<Key>) -> Subject {
        let mut place = |key: &Key| {
            inputs.iter().position(|known| known == key).unwrap_or_else(|| {
                inputs.push(*key);
                inputs.len() - 1
            })
        };
        let behavior = match &self.role {
            PerformerRole::Plain(behavior) => behavior(),
            PerformerRole::Untrained { teacher, seed, acts } => {
                Behavior::Untrained { teacher: duplicate(teacher), seed: seed.clone(), acts: *acts }
            }
            PerformerRole::Teacher { teacher, key, snapshot, acts } => Behavior::Teacher {
                teacher: duplicate(teacher),
                input: place(key),
                snapshot: *snapshot,
                acts: *acts,
            },
            PerformerRole::Infant { options, primitive_probability } => {
                let options =
                    options.iter().map(|(key, item)| Place { input: place(key), item: *item }).collect();
                Behavior::Infant { options, primitive_probability: *primitive_probability }
            }
        };
        Subject { name: self.name.clone(), behavior }
    }
}
