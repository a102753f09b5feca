//! What training and acting cost on one thread, with the networks of the usual PPO programs: `cargo bench -p
//! elo-learners`. Each line is the median of repeated runs; the last column counts allocations in a run after the
//! first.

use std::alloc::{GlobalAlloc, Layout, System};
use std::hint::black_box;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use elo_learners::kernels::clipped_surrogate::{SurrogateBatch, clipped_surrogate};
use elo_learners::kernels::running_moments::RunningMoments;
use elo_learners::kernels::value_loss::value_loss;
use elo_learners::nn::{
    Activations, Adam, DiagonalGaussian, GaussianBatch, Mlp, Scratch, clip_grad_norm, fill_standard_normal,
};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

struct Counting;

static ALLOCATIONS: AtomicU64 = AtomicU64::new(0);

// SAFETY: every call is passed on unchanged to the system's allocator; counting does not allocate.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller keeps `alloc`'s contract.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller keeps `dealloc`'s contract.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

const OBSERVATION: usize = 26;
const ACTION: usize = 6;

/// Prints the median time of a call, over 31 samples of enough calls to last some milliseconds.
fn measure(name: &str, mut run: impl FnMut()) {
    run();
    let before = ALLOCATIONS.load(Ordering::Relaxed);
    run();
    let allocations = ALLOCATIONS.load(Ordering::Relaxed) - before;
    let start = Instant::now();
    run();
    let calls = (5e-3 / start.elapsed().as_secs_f64().max(1e-8)).ceil() as u32;
    let mut samples: Vec<f64> = (0..31)
        .map(|_| {
            let start = Instant::now();
            (0..calls).for_each(|_| run());
            start.elapsed().as_secs_f64() * 1e6 / f64::from(calls)
        })
        .collect();
    samples.sort_by(f64::total_cmp);
    println!("{name:<46}{:>10.2} µs (fastest {:.2}){allocations:>6}", samples[15], samples[0]);
}

/// A policy and a critic in training, with one minibatch's worth of buffers.
struct Training {
    policy: Mlp,
    critic: Mlp,
    log_std: Vec<f32>,
    optimisers: [Adam; 3],
    activations: [Activations; 2],
    gradients: [Vec<f32>; 3],
    observations: Vec<f32>,
    actions: Vec<f32>,
    d_means: Vec<f32>,
    rows: [Vec<f32>; 6],
}

impl Training {
    fn new(width: usize, batch: usize) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut network = |output, gain| {
            Mlp::orthogonal(&[OBSERVATION, width, width, output], gain, &mut rng).expect("no width is zero")
        };
        let (policy, critic) = (network(ACTION, 0.01), network(1, 1.0));
        let sizes = [policy.params().len(), critic.params().len(), ACTION];
        let mut normal = |count| {
            let mut values = vec![0.0; count];
            fill_standard_normal(&mut rng, &mut values);
            values
        };
        let (observations, actions) = (normal(batch * OBSERVATION), normal(batch * ACTION));
        let mut rows = [(); 6].map(|()| normal(batch));
        rows[1].fill(-8.0);
        Self {
            activations: [policy.activations(), critic.activations()],
            optimisers: sizes.map(Adam::new),
            gradients: sizes.map(|size| vec![0.0; size]),
            log_std: vec![0.0; ACTION],
            policy,
            critic,
            d_means: actions.clone(),
            observations,
            actions,
            rows,
        }
    }

    fn step(&mut self) {
        let [log_probs, old_log_probs, advantages, targets, d_log_probs, d_values] = &mut self.rows;
        let [d_policy, d_critic, d_log_std] = &mut self.gradients;
        let [of_policy, of_critic] = &mut self.activations;
        d_policy.fill(0.0);
        d_critic.fill(0.0);
        d_log_std.fill(0.0);

        let means = self.policy.forward(&self.observations, of_policy);
        let head = GaussianBatch { means, log_std: &self.log_std, actions: &self.actions };
        head.log_probs(log_probs);
        let batch = SurrogateBatch { log_probs, old_log_probs, advantages };
        black_box(clipped_surrogate(&batch, 0.2, d_log_probs));
        head.backward(d_log_probs, &mut self.d_means, d_log_std);
        self.policy.backward(of_policy, &self.d_means, d_policy);

        let values = self.critic.forward(&self.observations, of_critic);
        black_box(value_loss(values, targets, d_values));
        self.critic.backward(of_critic, d_values, d_critic);

        black_box(clip_grad_norm(&mut [d_policy, d_critic, d_log_std], 0.5));
        let [policy, critic, log_std] = &mut self.optimisers;
        policy.step(self.policy.params_mut(), d_policy, 1e-6);
        critic.step(self.critic.params_mut(), d_critic, 1e-6);
        log_std.step(&mut self.log_std, d_log_std, 1e-6);
    }
}

fn main() {
    println!("{:<46}{:>13}{:>28}", "", "median", "allocations");
    for (width, batch) in [(64, 64), (64, 256), (256, 256)] {
        let mut training = Training::new(width, batch);
        measure(&format!("minibatch step, {width}×{width}, batch {batch}"), || training.step());
        let Training { critic, policy, activations: [of_policy, of_critic], observations, actions, .. } =
            &mut training;
        measure("  policy forward", || {
            black_box(policy.forward(observations, of_policy));
        });
        let mut gradient = vec![0.0; policy.params().len()];
        measure("  policy backward", || policy.backward(of_policy, actions, &mut gradient));
        let values = critic.forward(observations, of_critic).to_vec();
        measure("  critic forward", || {
            black_box(critic.forward(observations, of_critic));
        });
        let mut gradient = vec![0.0; critic.params().len()];
        measure("  critic backward", || critic.backward(of_critic, &values, &mut gradient));
        measure("  clip, one network", || {
            black_box(clip_grad_norm(&mut [&mut gradient], 1e9));
        });
        let mut adam = Adam::new(gradient.len());
        measure("  Adam, one network", || adam.step(critic.params_mut(), &gradient, 1e-6));
    }
    for width in [64, 256] {
        let training = Training::new(width, 1);
        let (mut scratch, mut means) = (Scratch::default(), [0.0; ACTION]);
        measure(&format!("forward of one, {width}×{width}"), || {
            training.policy.forward_one(black_box(&training.observations), &mut scratch, &mut means);
        });
    }
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let mut action = [0.0; ACTION];
    measure("sample an action of 6", || {
        DiagonalGaussian { means: &[0.0; ACTION], log_std: &[0.0; ACTION] }.sample(&mut rng, &mut action);
        black_box(&action);
    });
    let mut moments = RunningMoments::new(OBSERVATION);
    let mut observation = [0.5; OBSERVATION];
    measure("moments of an observation of 26", || moments.update(black_box(&observation)));
    let normalizer = moments.normalizer();
    measure("normalise an observation of 26", || {
        normalizer.apply(&black_box([0.5; OBSERVATION]), &mut observation)
    });
}
