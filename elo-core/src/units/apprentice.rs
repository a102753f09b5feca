//! Algorithm 1(a), the loop's last line, for learners that also try themselves and are corrected by the teacher.

use serde::{Deserialize, Serialize};

use super::arena::Arena;
use super::learn::encode;
use super::record::{self, Record, Recording};
use super::{Site, Work, WorkError, input};
use crate::agent::InfantAgent;
use crate::context::Context;
use crate::policy::{
    Demonstration, Monitor, OptionLearner, OptionPolicy, PolicyRecord, TeacherPolicy, Tutor, Way,
};
use crate::rollout::{Setting, Tape, watched};
use crate::seed::Seed;
use crate::spec::SimulatorSpec;
use crate::task::Task;

/// Options for the candidates of a recording stage. The first input holds their recordings, the others are those of that
/// stage. The result is read as that of [`super::learn`].
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Apprentice {
    /// The option learner; one that asks its teacher.
    pub learner: Box<dyn OptionLearner>,
    /// How the recordings came about.
    pub recording: Record,
    /// The root of the stage's streams; candidate `i` draws from its child `i` alone.
    pub seed: Seed,
}

impl Apprentice {
    pub(super) fn perform(
        &self,
        inputs: &[Vec<u8>],
        site: &mut Site,
        monitor: &mut dyn Monitor,
    ) -> Result<Vec<u8>, WorkError> {
        let Way::Apprentices(learner) = self.learner.way() else {
            return Err(WorkError::Failed("this option learner asks no teacher".to_owned()));
        };
        let Record { simulator, tasks, span, .. } = &self.recording;
        let recordings = record::decode(input(inputs, 0)?)?;
        let mut arena = Arena::new(site, simulator.as_ref());
        let spec = arena.simulator()?.spec().clone();
        let teachers = self.recording.teachers(&inputs[1..], &spec)?;
        let mut options: Vec<Option<PolicyRecord>> = Vec::with_capacity(recordings.len());
        for ((i, seed), Recording { teacher, demonstration, .. }) in span.seeds(&self.seed).zip(&recordings) {
            monitor.progress(options.len() as u64, span.count as u64)?;
            let Some(demonstration) = demonstration else {
                options.push(None);
                continue;
            };
            let mut tutor = Lesson {
                recording: &self.recording,
                task: &tasks[*teacher],
                teacher: teachers[*teacher].as_ref(),
                spec: &spec,
                arena: &mut arena,
            };
            let learned = learner.learn(demonstration, &mut tutor, &seed);
            let option = learned.map_err(|why| WorkError::Failed(format!("candidate {i}: {why}")))?;
            options.push(Some(option.record()));
        }
        Ok(encode(&options))
    }
}

/// One teacher's correction of one apprentice.
struct Lesson<'a, 'b> {
    recording: &'a Record,
    task: &'a Task,
    teacher: &'a dyn TeacherPolicy,
    spec: &'a SimulatorSpec,
    arena: &'a mut Arena<'b>,
}

impl Tutor for Lesson<'_, '_> {
    fn spec(&self) -> &SimulatorSpec {
        self.spec
    }

    fn correct(&mut self, option: &dyn OptionPolicy, seed: &Seed) -> Result<Demonstration, String> {
        let spec = self.spec;
        let Record { initial_states, horizon, .. } = self.recording;
        let start = self.arena.start(initial_states, self.task, &seed.child("start"));
        let context = Context { task: self.task.clone(), start: start.map_err(|error| error.to_string())? };
        let tried = self.arena.roll_out(|simulator| {
            let options = [option];
            let mut agent = InfantAgent::new(&options, spec);
            let mut tape = Tape::default();
            let setting = Setting { context: &context, horizon };
            let noise = &mut seed.child("noise").stream();
            let rollout = watched(simulator, &mut agent, setting, noise, &mut tape);
            (rollout, tape)
        });
        let (_, tape) = tried.map_err(|error| error.to_string())?;
        let observations = tape.observations;
        let steps = observations.len() / spec.observation_size;
        let mut actions = vec![0.0; steps * spec.action_size()];
        let states = observations.chunks_exact(spec.observation_size);
        for (state, action) in states.zip(actions.chunks_exact_mut(spec.action_size())) {
            self.teacher.act(state, None, action);
        }
        if !actions.iter().all(|x| x.is_finite()) {
            let why = self.teacher.trouble().unwrap_or_else(|| "its action is not finite".to_owned());
            return Err(format!("the teacher: {why}"));
        }
        Ok(Demonstration { observations, actions, steps })
    }
}

impl From<Apprentice> for Work {
    fn from(work: Apprentice) -> Self {
        Self::Apprentice(work)
    }
}
