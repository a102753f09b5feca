//! Proximal policy optimisation (§2.1.2 of Weber et al. 2019; Schulman et al. 2017), from top to bottom: collect,
//! estimate advantages, descend on minibatches, log.

use elo_core::policy::{CurvePoint, Lesson, Monitor, Snapshot, TeacherConfig as _, TrainError, Trained};
use elo_core::seed::Seed;
use elo_core::simulator::End;
use elo_core::spec::SimulatorSpec;
use rand::seq::SliceRandom as _;

use super::checkpoint::Progress;
use super::config::PpoConfig;
use super::environment::{Course, Environment, Episode, Outcome};
use super::experience::{Experience, Minibatch};
use super::learner::Learner;
use super::policy::GaussianMlpTeacher;
use crate::acting::{Teller, draw_contexts};
use crate::fields::refuse_faults;
use crate::kernels::clipped_surrogate::{SurrogateBatch, clipped_surrogate, typical_kl};
use crate::kernels::gae::{Discount, StepEnd, Trajectory, gae, normalize, value_targets};
use crate::kernels::running_moments::Normalizer;
use crate::kernels::value_loss::value_loss;
use crate::nn::{DiagonalGaussian, GaussianBatch, Scratch, clip_grad_norm};
use crate::normalized_mlp::NormalizedMlp;

/// Trains one teacher: `θ_{k+1} = argmax_θ E[L(s, a, θ_k, θ)]` (Eq. 2.3) again and again.
pub(super) fn train(
    config: &PpoConfig,
    lesson: &Lesson<'_>,
    monitor: &mut dyn Monitor,
) -> Result<Trained, TrainError> {
    let mut training = Training::new(config, lesson)?;
    let mut progress = match monitor.resume() {
        Some(bytes) => training.read(&bytes)?,
        None => Progress::new(config, &training.spec, &lesson.seed),
    };
    training.draw_starts(lesson, &progress, monitor)?;
    training.take_up(&mut progress, monitor)?;
    while progress.record.iteration < config.iterations() {
        training.iterate(&mut progress, monitor)?;
        monitor.progress(training.steps_done(&progress), config.simulator_steps())?;
        if training.checkpoint_is_due(&progress) {
            training.put_down(&mut progress);
            let bytes = progress.encode();
            monitor.checkpoint(&bytes)?;
            progress = training.read(&bytes)?;
            training.take_up(&mut progress, monitor)?;
        }
    }
    let policy = progress.snapshots.last().map(|last| last.policy.clone()).unwrap_or_default();
    Ok(Trained { policy, snapshots: progress.snapshots, curve: progress.record.curve })
}

/// Everything about a training that does not outlive the process.
struct Training<'a> {
    config: &'a PpoConfig,
    spec: SimulatorSpec,
    seed: Seed,
    course: Course<'a>,
    environments: Vec<Environment>,
    experience: Experience,
    minibatch: Minibatch,
    scratch: Scratch,
}

/// Episodes that ended in an iteration.
#[derive(Clone, Copy, Debug, Default)]
struct Ended {
    count: u64,
    total: f64,
    steps: u64,
}

impl Ended {
    fn add(&mut self, episode: &Episode) {
        self.count += 1;
        self.total += episode.total;
        self.steps += episode.steps;
    }
}

impl<'a> Training<'a> {
    /// Before its starts are drawn.
    fn new(config: &'a PpoConfig, lesson: &Lesson<'a>) -> Result<Self, TrainError> {
        refuse_faults(|faults| config.validate(faults)).map_err(TrainError::Other)?;
        let spec = lesson.simulator.build()?.spec().clone();
        let seed = lesson.seed.clone();
        let environments = (0..config.environments)
            .map(|index| Ok(Environment::new(index, lesson.simulator.build()?)))
            .collect::<Result<_, TrainError>>()?;
        let course = Course {
            task: lesson.task,
            prices: spec.prices(lesson.task),
            d0: Vec::new(),
            d0_share: config.d0_share,
            max_episode_steps: config.max_episode_steps,
            seed: seed.child("episodes"),
        };
        let shape = Learner::new(config, &spec, &seed);
        Ok(Self {
            experience: Experience::new(config, spec.observation_size, spec.action_size()),
            minibatch: Minibatch::new(&shape, config.minibatch),
            scratch: Scratch::default(),
            config,
            spec,
            seed,
            course,
            environments,
        })
    }

    /// Draws the starts from `d0` that episodes choose from.
    fn draw_starts(
        &mut self,
        lesson: &Lesson<'_>,
        progress: &Progress,
        monitor: &mut dyn Monitor,
    ) -> Result<(), TrainError> {
        let mut simulator = lesson.simulator.build()?;
        let tasks = std::iter::repeat_n(lesson.task.clone(), self.config.starts() as usize);
        let (done, total) = (self.steps_done(progress), self.config.simulator_steps());
        let mut word = || monitor.progress(done, total);
        let seed = self.seed.child("d0");
        let d0 = draw_contexts(lesson.initial_states, simulator.as_mut(), tasks, &seed, &mut word)?;
        self.course.d0 = d0.into_iter().map(|context| context.start).collect();
        Ok(())
    }

    /// One improvement of the policy, `θ_k → θ_{k+1}`.
    fn iterate(&mut self, progress: &mut Progress, monitor: &mut dyn Monitor) -> Result<(), TrainError> {
        let iteration = progress.record.iteration;
        let ended = self.collect(progress, monitor)?;
        self.estimate_advantages(&progress.learner);
        let kl = self.improve(&mut progress.learner, iteration);
        let kl = kl.map_err(|reason| self.diverged(progress, reason))?;
        if let Some(reason) = progress.learner.divergence(kl) {
            return Err(self.diverged(progress, reason));
        }
        progress.record.iteration += 1;
        self.log(progress, ended);
        Ok(())
    }

    /// Acts by `π_θk` and fills the experience with what came of it. Each observation is normalised by all that were seen until
    /// then, itself included.
    fn collect(&mut self, progress: &mut Progress, monitor: &mut dyn Monitor) -> Result<Ended, TrainError> {
        let before = self.steps_done(progress);
        let mut teller = Teller::new(monitor, self.config.simulator_steps());
        let Self { experience, environments, course, scratch, .. } = self;
        let Progress { learner: Learner { policy, log_std, critic, .. }, record, .. } = progress;
        let mut normalizer = record.moments.normalizer();
        let value = |normalizer: &Normalizer, seen: &[f32], scratch: &mut Scratch| {
            let (mut observation, mut value) = (vec![0.0; seen.len()], [0.0]);
            normalizer.apply(seen, &mut observation);
            critic.forward_one(&observation, scratch, &mut value);
            value[0]
        };
        let steps = self.config.steps_per_environment();
        let (inputs, actions) = (self.spec.observation_size, self.spec.action_size());
        let (mut seen, mut means) = (vec![0.0; inputs], vec![0.0; actions]);
        let mut ended = Ended::default();
        for (index, environment) in environments.iter_mut().enumerate() {
            let mut noise = self.seed.child("actions").index(record.iteration).index(index as u64).stream();
            let first = index * steps;
            let mut row = first;
            while row < first + steps {
                teller.step(before + row as u64)?;
                seen.copy_from_slice(environment.observation());
                record.moments.update(&seen);
                record.moments.refresh(&mut normalizer);
                let observation = &mut experience.observations[row * inputs..][..inputs];
                normalizer.apply(&seen, observation);
                policy.forward_one(observation, scratch, &mut means);
                let action = &mut experience.actions[row * actions..][..actions];
                DiagonalGaussian { means: &means, log_std }.sample(&mut noise, action);

                match environment.step(action, course, &mut record.tally)? {
                    Outcome::Step { reward, end } => {
                        experience.rewards[row] = record.scaler.scale(index, reward) as f32;
                        experience.ends[row] = match end {
                            End::Running => StepEnd::Running,
                            End::Terminated => StepEnd::Terminated,
                            End::Truncated => {
                                let final_value = value(&normalizer, environment.observation(), scratch);
                                StepEnd::Truncated { final_value }
                            }
                        };
                        row += 1;
                        if end == End::Running {
                            continue;
                        }
                        ended.add(environment.episode());
                    }
                    // The step did not take place; those before it were cut short.
                    Outcome::Failed if row > first && experience.ends[row - 1] == StepEnd::Running => {
                        experience.ends[row - 1] =
                            StepEnd::Truncated { final_value: value(&normalizer, &seen, scratch) };
                    }
                    Outcome::Failed => {}
                }
                record.scaler.end_episode(index);
                environment.begin(course, &mut record.tally)?;
            }
            experience.values_after[index] = value(&normalizer, environment.observation(), scratch);
        }
        Ok(ended)
    }

    /// `A_πθk(s, a)` of every step, by generalised advantage estimation, and what the critic should have said; also
    /// `log π_θk(a|s)`.
    fn estimate_advantages(&mut self, learner: &Learner) {
        let Self { experience, minibatch: Minibatch { activations: [of_policy, of_critic], .. }, .. } = self;
        let (inputs, actions) = (self.spec.observation_size, self.spec.action_size());
        let size = self.config.minibatch;
        for batch in 0..self.config.rollout_steps / size {
            let rows = batch * size..(batch + 1) * size;
            let observations = &experience.observations[rows.start * inputs..rows.end * inputs];
            let head = GaussianBatch {
                means: learner.policy.forward(observations, of_policy),
                log_std: &learner.log_std,
                actions: &experience.actions[rows.start * actions..rows.end * actions],
            };
            head.log_probs(&mut experience.log_probs[rows.clone()]);
            experience.values[rows].copy_from_slice(learner.critic.forward(observations, of_critic));
        }
        let discount = Discount { gamma: self.config.gamma, lambda: self.config.gae_lambda };
        let steps = self.config.steps_per_environment();
        for (index, &value_after) in experience.values_after.iter().enumerate() {
            let rows = index * steps..(index + 1) * steps;
            let trajectory = Trajectory {
                rewards: &experience.rewards[rows.clone()],
                values: &experience.values[rows.clone()],
                ends: &experience.ends[rows.clone()],
                value_after,
            };
            gae(&trajectory, discount, &mut experience.advantages[rows]);
        }
        value_targets(&experience.advantages, &experience.values, &mut experience.targets);
    }

    /// Epochs of gradient steps on shuffled minibatches, each with its advantages normalised. Returns how far the last one moved the policy. The error says why
    /// it cannot go on.
    fn improve(&mut self, learner: &mut Learner, iteration: u64) -> Result<f32, String> {
        let rate = self.config.rate(iteration);
        let mut order: Vec<usize> = (0..self.config.rollout_steps).collect();
        let mut shuffler = self.seed.child("shuffle").index(iteration).stream();
        let mut moved = 0.0;
        for _ in 0..self.config.epochs {
            order.shuffle(&mut shuffler);
            let mut divergences = Vec::with_capacity(order.len() / self.config.minibatch);
            for rows in order.chunks_exact(self.config.minibatch) {
                self.minibatch.gather(&self.experience, rows);
                normalize(&mut self.minibatch.advantages);
                divergences.push(descend(self.config, &mut self.minibatch, learner, rate)?);
            }
            moved = typical_kl(divergences);
            if f64::from(moved) >= self.config.target_kl {
                break;
            }
        }
        Ok(moved)
    }

    /// Notes what was seen, and keeps a policy now and then.
    fn log(&self, progress: &mut Progress, ended: Ended) {
        let steps = self.steps_done(progress);
        let Ended { count, total, steps: lengths } = ended;
        let mean = |sum: f64| (count > 0).then(|| sum / count as f64);
        let (mean_return, mean_length) = (mean(total), mean(lengths as f64));
        progress.record.curve.push(CurvePoint { steps, mean_return, mean_length });
        let (done, all) = (progress.record.iteration, self.config.iterations());
        let kept = |iteration: u64| iteration * self.config.snapshots / all;
        if kept(done) > kept(done - 1) {
            let Learner { policy, log_std, .. } = &progress.learner;
            let mean = NormalizedMlp::new(progress.record.moments.normalizer(), policy.clone());
            let teacher = GaussianMlpTeacher::new(mean, log_std.clone(), &self.spec);
            progress.snapshots.push(Snapshot { steps, policy: teacher.to_tensors() });
        }
    }

    fn steps_done(&self, progress: &Progress) -> u64 {
        progress.record.iteration * self.config.rollout_steps as u64
    }

    fn checkpoint_is_due(&self, progress: &Progress) -> bool {
        let done = self.steps_done(progress);
        let before = done - self.config.rollout_steps as u64;
        let last = progress.record.iteration == self.config.iterations();
        !last && done / self.config.checkpoint_every > before / self.config.checkpoint_every
    }

    fn put_down(&self, progress: &mut Progress) {
        progress.record.environments = self.environments.iter().map(Environment::put_down).collect();
    }

    fn take_up(&mut self, progress: &mut Progress, monitor: &mut dyn Monitor) -> Result<(), TrainError> {
        let (done, total) = (self.steps_done(progress), self.config.simulator_steps());
        let record = &mut progress.record;
        for (index, (environment, rest)) in self.environments.iter_mut().zip(&record.environments).enumerate()
        {
            monitor.progress(done, total)?;
            if !environment.take_up(rest, &self.course, &mut record.tally)? {
                record.scaler.end_episode(index);
            }
        }
        Ok(())
    }

    fn read(&self, bytes: &[u8]) -> Result<Progress, TrainError> {
        Progress::decode(bytes, self.config, &self.spec).map_err(|error| TrainError::Other(error.to_string()))
    }

    fn diverged(&self, progress: &Progress, reason: String) -> TrainError {
        TrainError::Diverged { steps: progress.record.tally.steps, reason }
    }
}

/// One step of stochastic gradient descent on `−L` (Eq. 2.4), the critic's squared error and the entropy bonus. Returns
/// how far the policy had moved before it.
fn descend(
    config: &PpoConfig,
    batch: &mut Minibatch,
    learner: &mut Learner,
    rate: f64,
) -> Result<f32, String> {
    let Minibatch { activations: [of_policy, of_critic], gradients, .. } = batch;
    gradients.iter_mut().for_each(|gradient| gradient.fill(0.0));
    let [d_policy, d_log_std, d_critic] = gradients;

    let means = learner.policy.forward_loaded(of_policy);
    let head = GaussianBatch { means, log_std: &learner.log_std, actions: &batch.actions };
    head.log_probs(&mut batch.log_probs);
    let actions = SurrogateBatch {
        log_probs: &batch.log_probs,
        old_log_probs: &batch.old_log_probs,
        advantages: &batch.advantages,
    };
    let surrogate = clipped_surrogate(&actions, config.clip as f32, &mut batch.d_log_probs);
    head.backward(&batch.d_log_probs, &mut batch.d_means, d_log_std);
    learner.policy.backward(of_policy, &batch.d_means, d_policy);
    // The entropy grows by one nat with each logarithm of a standard deviation.
    d_log_std.iter_mut().for_each(|d| *d -= config.entropy_coefficient as f32);

    let values = learner.critic.forward_loaded(of_critic);
    let critic_loss = value_loss(values, &batch.targets, &mut batch.d_values);
    batch.d_values.iter_mut().for_each(|d| *d *= config.value_coefficient as f32);
    learner.critic.backward(of_critic, &batch.d_values, d_critic);

    let norm =
        clip_grad_norm(&mut [&mut *d_policy, &mut *d_log_std, &mut *d_critic], config.max_grad_norm as f32);
    if !(surrogate.loss.is_finite() && critic_loss.is_finite() && norm.is_finite()) {
        let (loss, kl) = (surrogate.loss, surrogate.approx_kl);
        return Err(format!(
            "not finite: policy loss {loss}, critic loss {critic_loss}, gradient {norm}, divergence {kl}"
        ));
    }
    let [policy, log_std, critic] = &mut learner.optimisers;
    policy.step(learner.policy.params_mut(), d_policy, rate);
    log_std.step(&mut learner.log_std, d_log_std, rate);
    critic.step(learner.critic.params_mut(), d_critic, rate);
    Ok(surrogate.approx_kl)
}

#[cfg(test)]
mod tests;
