//! Who is run in contexts, and which units' results it needs for that.

use crate::discover::{Candidate, duplicate};
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
    Untrained(Box<dyn TeacherConfig>, Seed),
    /// The teacher of a unit.
    Teacher(Box<dyn TeacherConfig>, Key),
    /// The infant agent with these options.
    Infant(Vec<(Key, usize)>),
}

impl Performer {
    /// A candidate by itself.
    pub fn candidate(candidate: &Candidate) -> Self {
        let role = PerformerRole::Infant(vec![(candidate.key, candidate.item)]);
        Self { name: format!("option {}", candidate.number), role }
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
            PerformerRole::Untrained(teacher, seed) => {
                Behavior::Untrained { teacher: duplicate(teacher), seed: seed.clone() }
            }
            PerformerRole::Teacher(teacher, key) => {
                Behavior::Teacher { teacher: duplicate(teacher), input: place(key) }
            }
            PerformerRole::Infant(options) => {
                let options =
                    options.iter().map(|(key, item)| Place { input: place(key), item: *item }).collect();
                Behavior::Infant { options, primitive_probability: 0.0 }
            }
        };
        Subject { name: self.name.clone(), behavior }
    }
}
