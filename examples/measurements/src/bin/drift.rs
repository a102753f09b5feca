//! How far clones of recordings drift from what they imitate, as CSV: teachers of a finished run and clones of their recordings,
//! both from the recording's own start and from another one.
//!
//! ```sh
//! cargo run --release -p measurements --features mujoco --bin drift -- runs/ant 50 behavior_cloning > drift.csv
//! ```
//!
//! Arguments: folder of a finished run, number of recordings, an option learner that imitates (with its defaults). Errors are
//! roots of the mean squared difference between the clone's and the teacher's action: `seen` in the states of the recording,
//! `met` in the states that the clone itself comes to.

use std::path::Path;

use elo_core::agent::{Agent, InfantAgent, Taught};
use elo_core::context::{Context, PreparedStart};
use elo_core::crew::{Crew, Unwatched};
use elo_core::discover::{Run, discover};
use elo_core::policy::{Demonstration, OptionLearner, OptionPolicy, TeacherPolicy, Way};
use elo_core::rollout::{Ending, Horizon, Rollout, Setting, Tape, price, watched};
use elo_core::seed::Seed;
use elo_core::simulator::{Simulator, SimulatorError};
use elo_core::spec::SimulatorSpec;
use elo_core::units::train::TeacherResult;
use measurements::{Failure, PLUGINS, plugin, with_crew};

/// Starts that are tried until a teacher outlives the recording.
const TAKES: u64 = 100;

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [folder, count, learner] = arguments.as_slice() else {
        return Err("expected: RUN RECORDINGS LEARNER, e.g. runs/ant 50 behavior_cloning".into());
    };
    let (folder, count) = (Path::new(folder), count.parse()?);
    let experiment = elo_cli::load::of_run(folder, &PLUGINS)?;
    let learner: Box<dyn OptionLearner> = plugin(learner, &[])?;
    with_crew(&experiment, folder, &Unwatched, |crew| {
        print(&Run::new(&experiment, crew)?, crew, count, learner.as_ref())
    })
}

fn print(run: &Run<'_>, crew: &Crew<'_>, count: u64, learner: &dyn OptionLearner) -> Result<(), Failure> {
    let Way::Imitates(learner) = learner.way() else { return Err("this learner does not imitate".into()) };
    let horizon = Horizon { stop_at_fall: true, ..run.experiment.discover.horizon() };
    let spec = run.experiment.simulator.spec()?;
    let mut world = World { run, simulator: run.experiment.simulator.build()?, horizon };
    let teachers = discover(run.experiment, crew)?.teachers;
    let root = Seed::root(1).child("drift");
    println!("teacher,start,teacher_return,teacher_steps,clone_return,clone_steps,seen,met");
    for number in 0..count {
        let seed = root.index(number);
        let index = (number % teachers.len() as u64) as usize;
        let trained = TeacherResult::decode(&crew.result(&teachers[index].key)?)?.trained;
        let Some(trained) = trained else { continue };
        let teacher = run.teacher()?.load(&trained.policy, &spec)?;
        let mut context = Context { task: teachers[index].task.clone(), start: PreparedStart::standard(0) };
        let Some((taught, recording)) = world.record(teacher.as_ref(), &mut context, &seed)? else {
            continue;
        };
        let option = learner.learn(&recording, &spec, &seed.child("option"))?;
        let seen = difference(option.as_ref(), teacher.as_ref(), &recording.observations, &spec);

        let own = (context.clone(), taught);
        context.start = world.start(&context, &seed.child("other"))?;
        let other = (context.clone(), world.act(&mut by(teacher.as_ref()), &context, &seed).0);
        for (name, (context, taught)) in [("own", own), ("other", other)] {
            let options = [option.as_ref()];
            let (cloned, tape) = world.act(&mut InfantAgent::new(&options, &spec), &context, &seed);
            let met = difference(option.as_ref(), teacher.as_ref(), &tape.observations, &spec);
            let worth = |rollout: &Rollout| price(&rollout.term_sums, &spec.prices(&context.task));
            println!(
                "{index},{name},{:.2},{},{:.2},{},{seen:.4},{met:.4}",
                worth(&taught),
                taught.length,
                worth(&cloned),
                cloned.length
            );
        }
    }
    Ok(())
}

fn by(policy: &dyn TeacherPolicy) -> Taught<'_> {
    Taught { policy, sampling: false }
}

/// Where everybody acts.
struct World<'a> {
    run: &'a Run<'a>,
    simulator: Box<dyn Simulator>,
    horizon: Horizon,
}

impl World<'_> {
    fn start(&mut self, context: &Context, seed: &Seed) -> Result<PreparedStart, SimulatorError> {
        self.run.experiment.initial_states.draw(self.simulator.as_mut(), &context.task, seed)
    }

    /// A rollout of a teacher that does not fall; its start goes into `context`.
    fn record(
        &mut self,
        teacher: &dyn TeacherPolicy,
        context: &mut Context,
        seed: &Seed,
    ) -> Result<Option<(Rollout, Demonstration)>, SimulatorError> {
        for take in 0..TAKES {
            context.start = self.start(context, &seed.child("take").index(take))?;
            let (rollout, Tape { observations, actions }) = self.act(&mut by(teacher), context, seed);
            if rollout.ending == Ending::Horizon {
                let steps = self.horizon.steps;
                return Ok(Some((rollout, Demonstration { observations, actions, steps })));
            }
        }
        Ok(None)
    }

    fn act(&mut self, agent: &mut dyn Agent, context: &Context, seed: &Seed) -> (Rollout, Tape) {
        let mut tape = Tape::default();
        let setting = Setting { context, horizon: &self.horizon };
        let noise = &mut seed.child("noise").stream();
        (watched(self.simulator.as_mut(), agent, setting, noise, &mut tape), tape)
    }
}

/// Root of the mean squared difference between what the two do in states `seen`.
fn difference(
    option: &dyn OptionPolicy,
    teacher: &dyn TeacherPolicy,
    seen: &[f32],
    spec: &SimulatorSpec,
) -> f64 {
    let mut noise = Seed::root(0).stream();
    let (mut answer, mut expected) = (vec![0.0; spec.action_size()], vec![0.0; spec.action_size()]);
    let (mut squares, mut count) = (0.0, 0);
    for (elapsed, state) in seen.chunks_exact(spec.observation_size).enumerate() {
        option.act(state, elapsed, &mut noise, &mut answer);
        teacher.act(state, None, &mut expected);
        spec.clip(&mut expected);
        squares += answer.iter().zip(&expected).map(|(a, e)| f64::from(a - e).powi(2)).sum::<f64>();
        count += answer.len();
    }
    (squares / f64::from(u32::try_from(count).unwrap_or(u32::MAX))).sqrt()
}
