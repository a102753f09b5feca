//! Rollouts that were measured, to be looked at in three dimensions.

use serde::{Deserialize, Serialize};

use crate::crew::{RunError, Unit};
use crate::discover::{CONTEXTS_PER_UNIT, ContextSet, Discovery, Run};
use crate::performer::{Performer, PerformerRole};
use crate::scene::{Film, Scene};
use crate::simulator::Engine;
use crate::units::evaluate::Behavior;
use crate::units::film::{self, Filmed};

/// Some rollouts of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Replay {
    /// What moved it.
    pub engine: Engine,
    /// Simulated seconds between two steps of a film.
    pub control_step: f64,
    /// What is to be seen.
    pub scene: Scene,
    /// Performer by performer, in each one the contexts in order.
    pub films: Vec<FilmOf>,
}

/// One rollout.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FilmOf {
    /// [`Performer::name`].
    pub who: String,
    /// Number of the context in its split.
    pub context: usize,
    /// What it looks like. A rollout that failed goes as far as it came, and its return is [`Run::return_floor`], as in
    /// the report.
    pub film: Film,
}

/// The chosen options and random torque in the first `count` held-out contexts, on the run's own simulator and on those of
/// `others`, which are as in [`crosscheck`](crate::crosscheck::crosscheck): one replay for each that can be seen.
///
/// # Errors
/// See [`RunError`]; also another robot or other reward terms.
pub fn replays(
    run: &Run<'_>,
    discovery: &Discovery,
    others: &[Run<'_>],
    count: usize,
) -> Result<Vec<Replay>, RunError> {
    run.comparable_with(others)?;
    let own = run.held_out_contexts(run.experiment.report.contexts)?;
    let mut performers: Vec<Performer> = discovery
        .selection
        .chosen()
        .iter()
        .map(|id| Performer::candidate(&discovery.candidates[*id]))
        .collect();
    let role = PerformerRole::Plain(|| Behavior::RandomTorque);
    performers.push(Performer { name: "random torque".to_owned(), role });
    let mut replays = Vec::new();
    for there in std::iter::once(run).chain(others) {
        replays.extend(replay(there, &performers, &there.same_contexts(run, &own)?, count)?);
    }
    Ok(replays)
}

/// The rollouts of `performers` in the first `count` of `contexts`: the very ones that [`Run::evaluate`] measures. `None`
/// when the simulator cannot be seen. A performer for whom no worker could be kept alive is left out, and so is a rollout
/// that failed at its start.
///
/// Costs performers · count · T control steps, less what the run directory holds already.
///
/// # Errors
/// See [`RunError`].
pub fn replay(
    run: &Run<'_>,
    performers: &[Performer],
    contexts: &ContextSet,
    count: usize,
) -> Result<Option<Replay>, RunError> {
    let count = count.min(contexts.count);
    let blocks = 0..count.div_ceil(CONTEXTS_PER_UNIT);
    let unit = |performer: &Performer, block: usize| {
        let (rollouts, inputs) = run.rollouts(std::slice::from_ref(performer), contexts, block);
        let first = (count - block * CONTEXTS_PER_UNIT).min(CONTEXTS_PER_UNIT);
        Unit { work: film::Film { rollouts, first }.into(), inputs }
    };
    let units: Vec<Unit> =
        performers.iter().flat_map(|who| blocks.clone().map(move |block| unit(who, block))).collect();
    let keys = run.crew.complete("films", &units)?;
    let (mut scene, mut films) = (None, Vec::new());
    for (performer, keys) in performers.iter().zip(keys.chunks(blocks.len().max(1))) {
        for (block, key) in keys.iter().enumerate() {
            let filmed = Filmed::decode(&run.crew.result(key)?)?;
            scene = scene.or(filmed.scene);
            let takes = filmed.takes.into_iter().enumerate().filter(|(_, take)| !take.steps.is_empty());
            films.extend(takes.map(|(j, take)| FilmOf {
                who: performer.name.clone(),
                context: block * CONTEXTS_PER_UNIT + j,
                film: Film { steps: take.steps, returns: take.returns.unwrap_or_else(|| run.return_floor()) },
            }));
        }
    }
    let engine = run.experiment.simulator.engine();
    Ok(scene.map(|scene| Replay { engine, control_step: run.spec.control_step, scene, films }))
}
