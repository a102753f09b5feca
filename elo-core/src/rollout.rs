//! The only loop that steps a simulator to measure something.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::agent::Agent;
use crate::context::{Context, continue_past_end};
use crate::seed::Stream;
use crate::simulator::{End, Simulator, SimulatorError, check_finite};

/// How long a rollout lasts and what is summed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Horizon {
    /// Control steps at most; at least 1.
    pub steps: usize,
    /// `γ` of the return, in (0, 1].
    pub discount: f64,
    /// Whether a fall ends the return (its step's reward counts, nothing after it). Otherwise the rollout goes on from
    /// the fallen state, for simulators whose state can be set.
    pub stop_at_fall: bool,
}

impl fmt::Display for Horizon {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { steps, discount, stop_at_fall } = self;
        write!(f, "`steps` {steps}, `discount` {discount}, `stop_at_fall` {stop_at_fall}")
    }
}

/// What one rollout gave.
#[derive(Clone, Debug, PartialEq)]
pub struct Rollout {
    /// `Σ γ^i term_i` of every reward term; their inner product with a task's prices is the return.
    pub term_sums: Vec<f64>,
    /// Control steps taken.
    pub length: u32,
    /// How it ended.
    pub ending: Ending,
    /// Steps whose action lay outside the spec's bounds and was clamped by the simulator.
    pub clamped: u32,
}

/// A hexadecimal number of this many digits is taken for an address of memory.
const ADDRESS_DIGITS: usize = 8;

/// How a rollout ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ending {
    /// It lasted the whole horizon.
    Horizon,
    /// The robot fell.
    Terminated,
    /// The environment cut it short. Its return is not that of the horizon, so it counts as failed.
    Truncated,
    /// The simulator gave up; the text says why. The other fields tell how far it came and mean nothing else.
    Failed(String),
}

impl Ending {
    /// Failed for this reason. Addresses of memory are blotted out, as of threads where an interpreter crashed: they differ
    /// from run to run, and what runs store must not.
    pub fn failed(reason: &str) -> Self {
        let mut parts = reason.split("0x");
        let mut told = parts.next().unwrap_or_default().to_owned();
        for part in parts {
            let digits = part.bytes().take_while(u8::is_ascii_hexdigit).count();
            told.push_str("0x");
            told.push_str(if digits >= ADDRESS_DIGITS { "…" } else { &part[..digits] });
            told.push_str(&part[digits..]);
        }
        Self::Failed(told)
    }

    /// Whether the sums are a return of the option rather than an accident of the simulator.
    pub fn is_valid(&self) -> bool {
        self.trouble().is_none()
    }

    /// Why it is none.
    pub fn trouble(&self) -> Option<&str> {
        match self {
            Self::Horizon | Self::Terminated => None,
            Self::Truncated => Some("cut short by the environment"),
            Self::Failed(reason) => Some(reason),
        }
    }
}

/// Sees every step of a rollout.
pub trait Witness {
    /// `action` was chosen at `observation`.
    fn step(&mut self, observation: &[f32], action: &[f32]);

    /// `simulator` stands at the start, or where a step has just left it: once more than there are steps.
    fn look(&mut self, _simulator: &dyn Simulator) {}
}

/// The witness that does not look.
impl Witness for () {
    fn step(&mut self, _: &[f32], _: &[f32]) {}
}

/// The witness that notes observations and actions as they come, row after row.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tape {
    /// What was seen before each action.
    pub observations: Vec<f32>,
    /// The actions as they were chosen.
    pub actions: Vec<f32>,
}

impl Witness for Tape {
    fn step(&mut self, observation: &[f32], action: &[f32]) {
        self.observations.extend_from_slice(observation);
        self.actions.extend_from_slice(action);
    }
}

/// Runs `agent` in `context`. A simulator's error becomes [`Ending::Failed`]: an outcome to be counted, never dropped.
///
/// Cost: the simulator's own steps and, besides them, a pass over observation, action and terms.
pub fn rollout(
    simulator: &mut dyn Simulator,
    agent: &mut dyn Agent,
    context: &Context,
    horizon: &Horizon,
    noise: &mut Stream,
) -> Rollout {
    watched(simulator, agent, Setting { context, horizon }, noise, &mut ())
}

/// Where and for how long a watched rollout runs.
#[derive(Clone, Copy, Debug)]
pub struct Setting<'a> {
    /// Its task and start.
    pub context: &'a Context,
    /// Its length.
    pub horizon: &'a Horizon,
}

/// [`rollout`] under the eyes of `witness`.
pub fn watched(
    simulator: &mut dyn Simulator,
    agent: &mut dyn Agent,
    setting: Setting<'_>,
    noise: &mut Stream,
    witness: &mut dyn Witness,
) -> Rollout {
    let mut so_far = Rollout {
        term_sums: vec![0.0; simulator.spec().reward_terms.len()],
        length: 0,
        ending: Ending::Horizon,
        clamped: 0,
    };
    if let Err(error) = run(simulator, agent, setting, noise, (witness, &mut so_far)) {
        so_far.ending = Ending::failed(&agent.trouble().unwrap_or_else(|| error.to_string()));
    }
    so_far
}

fn run(
    simulator: &mut dyn Simulator,
    agent: &mut dyn Agent,
    Setting { context, horizon }: Setting<'_>,
    noise: &mut Stream,
    (witness, so_far): (&mut dyn Witness, &mut Rollout),
) -> Result<(), SimulatorError> {
    let (low, high) = (simulator.spec().action_low.clone(), simulator.spec().action_high.clone());
    let mut observation = vec![0.0; simulator.spec().observation_size];
    let mut action = vec![0.0; low.len()];
    let mut terms = vec![0.0; so_far.term_sums.len()];
    let mut weight = 1.0;

    context.start.begin(simulator, &context.task, &mut observation)?;
    witness.look(simulator);
    agent.begin(&observation, noise);
    for _ in 0..horizon.steps {
        agent.act(&observation, noise, &mut action);
        witness.step(&observation, &action);
        so_far.clamped +=
            u32::from(action.iter().zip(low.iter().zip(&high)).any(|(a, (l, h))| a < l || a > h));
        let end = simulator.step(&action, &mut observation, &mut terms)?;
        check_finite(&observation, &terms)?;
        for (sum, term) in so_far.term_sums.iter_mut().zip(&terms) {
            *sum += weight * term;
        }
        weight *= horizon.discount;
        so_far.length += 1;
        witness.look(simulator);
        match end {
            End::Running => {}
            End::Terminated if horizon.stop_at_fall => {
                so_far.ending = Ending::Terminated;
                return Ok(());
            }
            End::Terminated => continue_past_end(simulator, &context.task, &mut observation)?,
            End::Truncated => {
                so_far.ending = Ending::Truncated;
                return Ok(());
            }
        }
    }
    Ok(())
}

/// `R(τ) = Σ_k w_k(τ) · term_k`: the return that `prices` (see [`crate::spec::SimulatorSpec::prices`]) give to term sums.
pub fn price(term_sums: &[f64], prices: &[f64]) -> f64 {
    term_sums.iter().zip(prices).map(|(sum, price)| sum * price).sum()
}

#[cfg(test)]
mod tests {
    use super::Ending;

    #[test]
    fn a_reason_keeps_all_but_addresses() {
        let told = |reason| Ending::failed(reason).trouble().map(str::to_owned);
        let crash = "ended with signal 11 (SIGSEGV); it wrote:\n  Current thread 0x00007f3fa5f5c740 (most recent call first):";
        let stored =
            "ended with signal 11 (SIGSEGV); it wrote:\n  Current thread 0x… (most recent call first):";
        assert_eq!(told(crash).as_deref(), Some(stored));
        assert_eq!(
            told("<A object at 0x7f3fa5f5c740> and 0x5581DEADbeef").as_deref(),
            Some("<A object at 0x…> and 0x…")
        );
        for kept in ["", "exit code 3", "0x", "flags 0x1f, width 10x20é", "0xé0x12"] {
            assert_eq!(told(kept).as_deref(), Some(kept));
        }
    }
}
