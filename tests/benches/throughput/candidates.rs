//! Evaluating candidates beside the bare loop on the engine: same starts, actions and numbers of steps, without
//! observations, rewards and checks. The two sides alternate rollout by rollout.

use std::error::Error;
use std::hint::black_box;

use elo_backends::locomotion::robot::NAMES;
use elo_core::agent::InfantAgent;
use elo_core::context::{Context, InitialStates};
use elo_core::rollout::{Horizon, Rollout, rollout};
use elo_core::seed::Seed;
use elo_core::simulator::{Simulator, Start, State};
use elo_core::task::Task;

use crate::bare::{Bare, bare};
use crate::median;
use crate::processor_time::of_thread;
use crate::robots::{STEPS, linked, option, simulator, swinging};

const CONTEXTS: u64 = 24;
const ROUNDS: usize = 31;

/// Prints a line for every robot in every engine.
pub fn run() -> Result<(), Box<dyn Error>> {
    println!(
        "  processor time a control step, sums of the contexts' medians of {ROUNDS} rounds; aim: at least 0.95"
    );
    println!("  engine  robot          mean steps   bare us   elo us   bare/elo");
    for engine in linked() {
        for robot in NAMES {
            let mut duel = Duel::new(engine, robot)?;
            let steps = duel.rehearse()?;
            let [elo, bare] = duel.measure()?.map(|seconds| seconds * 1e6 / steps as f64);
            let mean = steps as f64 / CONTEXTS as f64;
            println!("  {engine:<7} {robot:<14} {mean:10.1}   {bare:7.2}   {elo:6.2}   {:8.3}", bare / elo);
        }
    }
    Ok(())
}

struct Duel {
    simulator: Box<dyn Simulator>,
    bare: Box<dyn Bare>,
    /// With each context, its option's actions; cut to the rollout's length once that is known.
    parts: Vec<(Context, Vec<f32>)>,
}

impl Duel {
    fn new(engine: &str, robot: &str) -> Result<Self, Box<dyn Error>> {
        let mut simulator = simulator(engine, robot).build()?;
        let seed = Seed::root(1);
        let mut parts = Vec::new();
        for j in 0..CONTEXTS {
            let task = Task::default();
            let start = InitialStates::default().draw(simulator.as_mut(), &task, &seed.index(j))?;
            let actions = swinging(simulator.spec(), &seed.child("option").index(j));
            parts.push((Context { task, start }, actions));
        }
        Ok(Self { simulator, bare: bare(engine, robot)?, parts })
    }

    /// Runs everything once, sees that both sides end at one place, and gives the number of steps of all rollouts.
    fn rehearse(&mut self) -> Result<usize, Box<dyn Error>> {
        let mut steps = 0;
        for j in 0..self.parts.len() {
            let (result, _) = self.elo(j)?;
            if !result.ending.is_valid() {
                return Err(format!("context {j}: {:?}", result.ending).into());
            }
            let length = result.length as usize;
            self.parts[j].1.truncate(length * self.simulator.spec().action_size());
            steps += length;
            self.bare(j)?;
            let ends = self.simulator.state()?.positions.into_iter().zip(self.bare.positions());
            let apart = ends.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            if apart > 1e-6 {
                return Err(format!("context {j}: the two sides part by {apart}").into());
            }
        }
        Ok(steps)
    }

    /// Seconds of all rollouts: this program's, and the bare loop's.
    fn measure(&mut self) -> Result<[f64; 2], Box<dyn Error>> {
        let mut sums = [0.0; 2];
        for j in 0..self.parts.len() {
            let (mut elo, mut bare) = (Vec::new(), Vec::new());
            for round in 0..ROUNDS {
                if round % 2 == 0 {
                    elo.push(self.elo(j)?.1);
                    bare.push(self.bare(j)?);
                } else {
                    bare.push(self.bare(j)?);
                    elo.push(self.elo(j)?.1);
                }
            }
            sums[0] += median(elo);
            sums[1] += median(bare);
        }
        Ok(sums)
    }

    fn elo(&mut self, j: usize) -> Result<(Rollout, f64), Box<dyn Error>> {
        let (context, actions) = &self.parts[j];
        let spec = self.simulator.spec().clone();
        // The rest is never played.
        let mut whole = actions.clone();
        whole.resize(STEPS * spec.action_size(), 0.0);
        let policy = option(&whole, &spec)?;
        let horizon = Horizon { steps: STEPS, discount: 1.0, stop_at_fall: true };
        let begin = of_thread();
        let mut noise = Seed::root(2).index(j as u64).stream();
        let options = [policy.as_ref()];
        let mut agent = InfantAgent::new(&options, &spec);
        let result = black_box(rollout(self.simulator.as_mut(), &mut agent, context, &horizon, &mut noise));
        Ok((result, of_thread() - begin))
    }

    fn bare(&mut self, j: usize) -> Result<f64, Box<dyn Error>> {
        let (context, actions) = &self.parts[j];
        let start: &State = match &context.start.start {
            Start::State(state) => state,
            Start::Seed(_) => return Err("a prepared start is a state".into()),
        };
        let begin = of_thread();
        self.bare.run(start, actions)?;
        Ok(of_thread() - begin)
    }
}
