//! A hill climber that breaks any one rule of the suite, and the demand that the right check finds it.

use std::sync::atomic::{AtomicU32, Ordering};

use rand::RngExt as _;
use serde::{Deserialize, Serialize};

use super::{CHECKS, Case};
use crate::agent::Taught;
use crate::conformance::liars::{Lie, demand_that_liars_are_caught};
use crate::conformance::point_mass::PointMassConfig;
use crate::context::{Context, PreparedStart};
use crate::fault::Faults;
use crate::policy::{
    CurvePoint, Lesson, Monitor, Snapshot, TeacherConfig, TeacherPolicy, TrainError, Trained,
};
use crate::rollout::{Horizon, rollout};
use crate::seed::{Seed, Stream};
use crate::spec::SimulatorSpec;
use crate::tensors::{TensorError, Tensors};

const ROUNDS: u64 = 6;
const STEPS: u64 = 20;

/// Keeps the better of two linear policies, six times over, but for one lie.
#[derive(Debug, Serialize, Deserialize)]
struct Climber {
    lie: String,
    #[serde(skip)]
    forgotten: f32,
    #[serde(skip)]
    trainings: AtomicU32,
}

/// What a checkpoint holds, as JSON.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Climb {
    round: u64,
    weights: Vec<f32>,
    score: f64,
    snapshots: Vec<(u64, Vec<f32>)>,
    curve: Vec<CurvePoint>,
}

/// Action `i` is the inner product of the observation and row `i` of the weights.
struct Linear {
    weights: Vec<f32>,
    lie: String,
    asked: AtomicU32,
}

impl Climber {
    fn is(&self, lie: &str) -> bool {
        self.lie == lie
    }

    fn begin(&self, checkpoint: Option<Vec<u8>>, size: usize) -> Result<Climb, TrainError> {
        let fresh = Climb {
            round: 0,
            weights: vec![0.0; size],
            score: f64::MIN,
            snapshots: Vec::new(),
            curve: Vec::new(),
        };
        let Some(bytes) = checkpoint else { return Ok(fresh) };
        match serde_json::from_slice::<Climb>(&bytes) {
            Ok(climb) if self.is("training_resumes_with_the_same_bytes") => {
                Ok(Climb { weights: fresh.weights, score: f64::MIN, ..climb })
            }

            Ok(climb) => Ok(climb),
            Err(_) if self.is("damaged_checkpoints_change_nothing") => {
                Ok(Climb { round: ROUNDS - 1, ..fresh })
            }
            Err(error) => Err(TrainError::Other(error.to_string())),
        }
    }

    fn tensors(&self, weights: &[f32], spec: &SimulatorSpec) -> Tensors {
        let mut tensors = Tensors::new();
        tensors.insert("weights", &[spec.action_size(), spec.observation_size], weights.to_vec());
        tensors
    }

    fn policy(&self, weights: Vec<f32>) -> Linear {
        Linear { weights, lie: self.lie.clone(), asked: AtomicU32::new(0) }
    }
}

#[typetag::serde(name = "climber")]
impl TeacherConfig for Climber {
    fn validate(&self, faults: &mut Faults) {
        faults.check(!self.is("config_is_valid"), "lie", || "expected the truth".to_owned());
    }

    fn simulator_steps(&self) -> u64 {
        ROUNDS * STEPS
    }

    fn train(&self, lesson: &Lesson<'_>, monitor: &mut dyn Monitor) -> Result<Trained, TrainError> {
        let mut simulator = lesson.simulator.build()?;
        let spec = simulator.spec().clone();
        let mut seed = lesson.seed.clone();
        if self.is("training_repeats") {
            seed = seed.index(u64::from(self.trainings.fetch_add(1, Ordering::Relaxed)));
        }
        if self.is("threads_change_nothing") {
            seed = seed.index(monitor.threads() as u64);
        }
        if self.is("config_survives_files") {
            seed = seed.child(&self.forgotten.to_string());
        }
        let mut climb = self.begin(monitor.resume(), spec.action_size() * spec.observation_size)?;
        let horizon = Horizon { steps: STEPS as usize, discount: 1.0, stop_at_fall: true };
        while climb.round < ROUNDS {
            let mut stream = seed.index(climb.round).stream();
            let tried: Vec<f32> = climb.weights.iter().map(|w| w + stream.random::<f32>() - 0.5).collect();
            // Each round has its own start, so a score of one round is luck in another.
            let start = PreparedStart::standard(seed.index(climb.round).child("start").number());
            let context = Context { task: lesson.task.clone(), start };
            let policy = Linear { lie: String::new(), ..self.policy(tried.clone()) };
            let mut agent = Taught { policy: &policy, sampling: false };
            let score = rollout(simulator.as_mut(), &mut agent, &context, &horizon, &mut stream).term_sums[0];
            if score > climb.score {
                (climb.weights, climb.score) = (tried, score);
            }
            climb.round += 1;
            let done = climb.round * STEPS;
            let seen = CurvePoint { steps: done, mean_return: Some(score), mean_length: None };
            climb
                .curve
                .push(CurvePoint { steps: if self.is("curves_go_forward") { STEPS } else { done }, ..seen });
            climb.snapshots.push((done, climb.weights.clone()));
            let reported = if self.is("progress_is_honest") { done + 1 } else { done };
            let go_on = monitor.progress(reported, self.simulator_steps());
            if !self.is("stops_are_obeyed") || climb.round > 1 {
                go_on?;
            }
            if climb.round.is_multiple_of(2) && climb.round < ROUNDS {
                monitor
                    .checkpoint(&serde_json::to_vec(&climb).map_err(|e| TrainError::Other(e.to_string()))?)?;
            }
        }
        let snapshot = |(steps, weights): &(u64, Vec<f32>)| Snapshot {
            steps: *steps,
            policy: self.tensors(weights, &spec),
        };
        let mut snapshots: Vec<Snapshot> = climb.snapshots.iter().map(snapshot).collect();
        if self.is("snapshots_lead_to_the_policy") {
            snapshots.reverse();
        }
        Ok(Trained { policy: self.tensors(&climb.weights, &spec), snapshots, curve: climb.curve })
    }

    fn untrained(&self, spec: &SimulatorSpec, seed: &Seed) -> Option<Tensors> {
        let mut stream = seed.stream();
        let asked = self.trainings.fetch_add(1, Ordering::Relaxed) as f32;
        let offset = if self.is("untrained_policies_repeat_and_load") { asked } else { 0.0 };
        let weights: Vec<f32> = (0..spec.action_size() * spec.observation_size)
            .map(|_| stream.random::<f32>() + offset)
            .collect();
        Some(self.tensors(&weights, spec))
    }

    fn load(&self, tensors: &Tensors, spec: &SimulatorSpec) -> Result<Box<dyn TeacherPolicy>, TensorError> {
        let shape = [spec.action_size(), spec.observation_size];
        let size = shape[0] * shape[1];
        let weights = match self.lie.as_str() {
            "missing_tensors_are_refused" if tensors.get("weights").is_err() => vec![0.0; size],
            "misshapen_tensors_are_refused" if tensors.get("weights")?.data.len() == size => {
                tensors.get("weights")?.data.clone()
            }
            "other_robots_are_refused" if tensors.get("weights")?.shape == [1, 2] => {
                tensors.get("weights")?.data.clone()
            }
            _ => tensors.get_shaped("weights", &shape)?.to_vec(),
        };
        if !self.is("nonfinite_tensors_are_refused") && !weights.iter().all(|w| w.is_finite()) {
            return Err(TensorError::NotFinite("weights".to_owned()));
        }
        Ok(Box::new(self.policy(weights)))
    }
}

impl TeacherPolicy for Linear {
    fn act(&self, observation: &[f32], noise: Option<&mut Stream>, action: &mut [f32]) {
        let shake = noise.map_or(0.0, |stream| stream.random::<f32>());
        let before = action.to_vec();
        for (i, a) in action.iter_mut().enumerate() {
            let row = self.weights.iter().skip(i * observation.len());
            *a = shake + row.zip(observation).map(|(w, x)| w * x).sum::<f32>();
        }
        match self.lie.as_str() {
            "acting_is_pure" => action[0] += self.asked.fetch_add(1, Ordering::Relaxed) as f32,
            "actions_are_filled" => action[0] += before[0],
            "actions_are_finite" if observation[0].abs() > 2.0 => action[0] = f32::INFINITY,
            _ => {}
        }
    }
}

fn case(lie: &str) -> Case {
    let teacher = Climber { lie: lie.to_owned(), forgotten: 1.0, trainings: AtomicU32::new(0) };
    Case::new(Box::new(teacher), Box::new(PointMassConfig::default()))
}

/// The liars, one for each check, with the checks that cannot help finding them too.
const LIES: &[(&str, &[&str])] = &[
    ("config_is_valid", &[]),
    ("config_survives_files", &[]),
    ("training_repeats", &["threads_change_nothing", "training_resumes_with_the_same_bytes"]),
    ("threads_change_nothing", &[]),
    ("stops_are_obeyed", &[]),
    ("training_resumes_with_the_same_bytes", &[]),
    ("damaged_checkpoints_change_nothing", &[]),
    ("snapshots_lead_to_the_policy", &[]),
    ("curves_go_forward", &[]),
    ("progress_is_honest", &[]),
    ("untrained_policies_repeat_and_load", &[]),
    ("acting_is_pure", &["actions_are_filled"]),
    ("actions_are_filled", &[]),
    ("actions_are_finite", &["untrained_policies_repeat_and_load"]),
    ("missing_tensors_are_refused", &[]),
    ("misshapen_tensors_are_refused", &[]),
    ("nonfinite_tensors_are_refused", &[]),
    ("other_robots_are_refused", &[]),
];

#[test]
fn an_honest_teacher_keeps_every_rule() {
    let report = super::run(&case("none"));
    assert!(report.failed().is_empty() && report.skipped().is_empty(), "{report}");
}

#[test]
fn each_liar_is_caught_by_the_check_that_is_meant_for_it() {
    let lies: Vec<_> = LIES
        .iter()
        .map(|(caught_by, also)| Lie { caught_by, also, subject: Box::new(case(caught_by)) })
        .collect();
    demand_that_liars_are_caught(CHECKS, &lies);
}
