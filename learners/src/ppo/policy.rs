//! The trained teacher.

use elo_core::policy::TeacherPolicy;
use elo_core::seed::Stream;
use elo_core::spec::SimulatorSpec;
use elo_core::tensors::{TensorError, Tensors};

use crate::nn::fill_standard_normal;
use crate::normalized_mlp::NormalizedMlp;

/// A Gaussian policy: its mean is a network's output for the normalised observation, its standard deviations are the
/// same everywhere. Actions are clipped to the robot's bounds.
///
/// As tensors: those of [`NormalizedMlp`] and `log_std` `[action components]`.
#[derive(Clone, Debug, PartialEq)]
pub struct GaussianMlpTeacher {
    mean: NormalizedMlp,
    log_std: Vec<f32>,
    spec: SimulatorSpec,
}

impl GaussianMlpTeacher {
    pub(super) fn new(mean: NormalizedMlp, log_std: Vec<f32>, spec: &SimulatorSpec) -> Self {
        Self { mean, log_std, spec: spec.clone() }
    }

    pub(super) fn to_tensors(&self) -> Tensors {
        let mut tensors = self.mean.to_tensors();
        tensors.insert("log_std", &[self.log_std.len()], self.log_std.clone());
        tensors
    }

    /// Reads a policy for a robot of `spec` with hidden layers of these widths.
    pub(super) fn from_tensors(
        tensors: &Tensors,
        spec: &SimulatorSpec,
        hidden: &[usize],
    ) -> Result<Self, TensorError> {
        let actions = spec.action_size();
        let mean = NormalizedMlp::from_tensors(tensors, spec.observation_size, actions)?;
        if mean.hidden() != hidden {
            let expected = format!("hidden layers of widths {hidden:?}");
            return Err(TensorError::Shape { name: "layer*".to_owned(), got: mean.hidden(), expected });
        }
        let log_std = tensors.get_shaped("log_std", &[actions])?.to_vec();
        if !log_std.iter().all(|x| x.is_finite()) {
            return Err(TensorError::NotFinite("log_std".to_owned()));
        }
        Ok(Self::new(mean, log_std, spec))
    }
}

impl GaussianMlpTeacher {
    fn explore(&self, noise: &mut Stream, action: &mut [f32]) {
        // Two at a time, which is how the stream gives them.
        for (means, log_std) in action.chunks_mut(2).zip(self.log_std.chunks(2)) {
            let mut normals = [0.0; 2];
            fill_standard_normal(noise, &mut normals[..means.len()]);
            for ((a, z), log_std) in means.iter_mut().zip(normals).zip(log_std) {
                *a += log_std.exp() * z;
            }
        }
    }
}

impl TeacherPolicy for GaussianMlpTeacher {
    fn act(&self, observation: &[f32], noise: Option<&mut Stream>, action: &mut [f32]) {
        self.mean.evaluate(observation, action);
        if let Some(noise) = noise {
            self.explore(noise, action);
        }
        self.spec.clip(action);
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use elo_core::conformance::point_mass::PointMassConfig;
    use elo_core::policy::TeacherConfig;
    use elo_core::seed::Seed;

    use super::*;
    use crate::kernels::running_moments::Normalizer;
    use crate::nn::{DiagonalGaussian, Mlp};
    use crate::ppo::PpoConfig;

    fn sample(actions: usize) -> GaussianMlpTeacher {
        let network = Mlp::orthogonal(&[2, 4, actions], 1.0, &mut Seed::root(1).stream()).unwrap();
        let log_std = (0..actions).map(|i| -0.5 + 0.25 * i as f32).collect();
        let mut spec = PointMassConfig::default().description();
        (spec.action_low, spec.action_high) = (vec![-1.0; actions], vec![1.0; actions]);
        GaussianMlpTeacher::new(NormalizedMlp::new(Normalizer::identity(2), network), log_std, &spec)
    }

    #[test]
    fn a_sample_is_the_one_that_training_would_draw() {
        for actions in [1, 2, 5] {
            let teacher = sample(actions);
            let (mut means, mut ours, mut theirs) =
                (vec![0.0; actions], vec![0.0; actions], vec![0.0; actions]);
            teacher.act(&[0.3, -0.2], None, &mut means);
            teacher.act(&[0.3, -0.2], Some(&mut Seed::root(2).stream()), &mut ours);
            let head = DiagonalGaussian { means: &means, log_std: &teacher.log_std };
            head.sample(&mut Seed::root(2).stream(), &mut theirs);
            theirs.iter_mut().for_each(|a| *a = a.clamp(-1.0, 1.0));
            assert_eq!(ours, theirs);
            assert_ne!(ours, means);
        }
    }

    #[test]
    fn a_saturating_teacher_acts_within_the_action_bounds() {
        let mut teacher = sample(2);
        (teacher.spec.action_low, teacher.spec.action_high) = (vec![-0.25, 0.0], vec![0.5, 2.0]);
        // Samples lie some twenty times the bounds away from their means.
        teacher.log_std = vec![3.0; 2];
        let (mut noise, mut action) = (Seed::root(5).stream(), [0.0; 2]);
        let mut reached = [[false; 2]; 2];
        for _ in 0..50 {
            teacher.act(&[0.3, -0.2], Some(&mut noise), &mut action);
            for (component, a) in action.iter().enumerate() {
                let bounds = [teacher.spec.action_low[component], teacher.spec.action_high[component]];
                assert!((bounds[0]..=bounds[1]).contains(a), "{action:?}");
                for (reached, bound) in reached[component].iter_mut().zip(bounds) {
                    *reached |= *a == bound;
                }
            }
        }
        assert_eq!(reached, [[true; 2]; 2]);
        // Without noise too, where the mean itself lies outside.
        let network = Mlp::orthogonal(&[2, 4, 1], 100.0, &mut Seed::root(1).stream()).unwrap();
        let spec = PointMassConfig::default().description();
        let mean = NormalizedMlp::new(Normalizer::identity(2), network);
        let strong = GaussianMlpTeacher::new(mean, vec![0.0], &spec);
        let acts = [[5.0, 5.0], [-5.0, -5.0]].map(|observation: [f32; 2]| {
            let mut action = [0.0];
            strong.act(&observation, None, &mut action);
            action[0]
        });
        assert_eq!(acts.map(f32::abs), [1.0; 2]);
    }

    #[test]
    fn a_stored_teacher_is_read_for_its_own_shape_only() {
        let spec = PointMassConfig::default().description();
        let teacher = sample(1);
        let tensors = Tensors::decode(&teacher.to_tensors().encode()).unwrap();
        assert_eq!(GaussianMlpTeacher::from_tensors(&tensors, &spec, &[4]).unwrap(), teacher);
        let error = GaussianMlpTeacher::from_tensors(&tensors, &spec, &[5, 5]).unwrap_err();
        assert_eq!(
            error.to_string(),
            "tensor `layer*` has shape [4], expected hidden layers of widths [5, 5]"
        );
        let mut spoilt = tensors.clone();
        spoilt.insert("log_std", &[1], vec![f32::NAN]);
        assert!(GaussianMlpTeacher::from_tensors(&spoilt, &spec, &[4]).is_err());
    }

    #[test]
    fn an_untrained_policy_hardly_moves_by_its_mean() {
        let (config, spec) = (PpoConfig::default(), PointMassConfig::default().description());
        let tensors = config.untrained(&spec, &Seed::root(3)).unwrap();
        assert_eq!(Some(&tensors), config.untrained(&spec, &Seed::root(3)).as_ref());
        assert_ne!(Some(&tensors), config.untrained(&spec, &Seed::root(4)).as_ref());
        let mut action = [1.0];
        config.load(&tensors, &spec).unwrap().act(&[1.0, -1.0], None, &mut action);
        assert!(action[0].abs() < 0.05, "{action:?}");
    }
}
