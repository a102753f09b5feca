//! Figures of return distributions, each with an interval over contexts.

use serde::{Deserialize, Serialize};

use crate::crew::RunError;
use crate::discover::value;
use crate::experiment::ReportPlan;
use crate::judge::Judge;
use crate::metric::{Metric, Reference};
use crate::returns::Scale;
use crate::rollout::{Ending, Rollout};
use crate::seed::{Seed, Stream};
use crate::statistics::StatisticsError;
use crate::statistics::bootstrap::{Interval, bootstrap, bootstrap_means, interval_of, paired_difference};
use crate::statistics::summary::interquartile_mean;
use crate::units::score::Score;

/// Figures of one return distribution.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Row {
    /// Whose.
    pub name: String,
    /// Mean return, as the tasks pay it.
    pub mean_return: Interval,
    /// Mean normalised return.
    pub mean: Interval,
    /// Interquartile mean of normalised returns.
    pub iqm: Interval,
    /// `Pr(V < μ* − α σ*)`.
    pub lower_tail: Interval,
    /// `Pr(V > μ*)`.
    pub upper_tail: Interval,
    /// Share of rollouts in which the robot fell.
    pub falls: Interval,
    /// Share of rollouts that failed and count as the return floor.
    pub failures: f64,
    /// Mean length in control steps.
    pub mean_length: f64,
}

/// A paired difference.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Comparison {
    /// The baseline.
    pub baseline: String,
    /// Mean return less that of the baseline, context by context.
    pub difference: Interval,
}

/// Somebody's returns with several members pooled: an entry a context, in it one return a member.
#[derive(Clone, Debug)]
pub struct Sample {
    /// Whose.
    pub name: String,
    /// As the tasks pay them.
    pub returns: Vec<Vec<f64>>,
    /// Share of the members that fell in each context.
    pub falls: Vec<f64>,
    failures: f64,
    mean_length: f64,
}

/// What returns are measured against, and how.
#[derive(Clone, Debug)]
pub struct Yardstick<'a> {
    /// The normalisation.
    pub scale: Scale,
    /// `(μ*, σ*)`, in normalised returns.
    pub reference: Reference,
    /// `α`, bootstrap draws and confidence.
    pub plan: &'a ReportPlan,
    /// What a failed rollout counts as.
    pub return_floor: f64,
    /// Where resamples of the contexts come from.
    pub seed: Seed,
}

impl Sample {
    /// Mean return of the members in each context.
    pub fn context_means(&self) -> Vec<f64> {
        self.returns.iter().map(|values| values.iter().sum::<f64>() / values.len() as f64).collect()
    }

    /// The sample under the other reading of a set's value (Eq. 4.2 to the letter): one return a context, the mean of the
    /// members'.
    pub fn averaged(mut self) -> Self {
        self.returns = self.context_means().into_iter().map(|value| vec![value]).collect();
        self
    }
}

/// One of the two tails that the metrics look at.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Tail {
    /// `V < μ* − α σ*`.
    Lower,
    /// `V > μ*`.
    Upper,
}

impl Yardstick<'_> {
    /// Pools `members`, each with one rollout a context; `prices` are those of the contexts' tasks.
    pub fn sample(&self, name: &str, members: &[&[Rollout]], prices: &[Vec<f64>]) -> Sample {
        let count = (members.len() * prices.len()) as f64;
        let fallen =
            |j: usize| members.iter().filter(|member| member[j].ending == Ending::Terminated).count() as f64;
        let all = || members.iter().flat_map(|member| member.iter());
        let member_value =
            |member: &&[Rollout], j: usize| value(&member[j], &prices[j]).unwrap_or(self.return_floor);
        Sample {
            name: name.to_owned(),
            returns: (0..prices.len())
                .map(|j| members.iter().map(|m| member_value(m, j)).collect())
                .collect(),
            falls: (0..prices.len()).map(|j| fallen(j) / members.len() as f64).collect(),
            failures: all().filter(|r| !r.ending.is_valid()).count() as f64 / count,
            mean_length: all().map(|r| f64::from(r.length)).sum::<f64>() / count,
        }
    }

    /// All figures of a sample.
    ///
    /// # Errors
    /// Fewer than two contexts, or returns that are not finite.
    pub fn row(&self, sample: &Sample) -> Result<Row, StatisticsError> {
        let normal = self.normal(sample);
        let normal_means: Vec<f64> =
            sample.context_means().iter().map(|value| self.scale.apply(*value)).collect();
        let iqm = |contexts: &[usize]| {
            let drawn: Vec<f64> = contexts.iter().flat_map(|j| normal[*j].iter().copied()).collect();
            interquartile_mean(&drawn).unwrap_or(f64::NAN)
        };
        let (lower, upper) = (self.tail_shares(sample, Tail::Lower), self.tail_shares(sample, Tail::Upper));
        let columns = [&sample.context_means(), &normal_means, &lower, &upper, &sample.falls];
        let ReportPlan { bootstrap_draws, confidence, .. } = *self.plan;
        let means =
            bootstrap_means(&columns.map(Vec::as_slice), bootstrap_draws, confidence, &mut self.stream())?;
        Ok(Row {
            name: sample.name.clone(),
            mean_return: means[0],
            mean: means[1],
            iqm: bootstrap(normal.len(), bootstrap_draws, confidence, &mut self.stream(), iqm)?,
            lower_tail: means[2],
            upper_tail: means[3],
            falls: means[4],
            failures: sample.failures,
            mean_length: sample.mean_length,
        })
    }

    /// The normalised returns of a sample.
    pub fn normal(&self, sample: &Sample) -> Vec<Vec<f64>> {
        let scaled = |values: &Vec<f64>| values.iter().map(|value| self.scale.apply(*value)).collect();
        sample.returns.iter().map(scaled).collect()
    }

    /// Where a tail begins, in normalised returns.
    pub fn threshold(&self, tail: Tail) -> f64 {
        match tail {
            Tail::Lower => self.reference.mean - self.plan.alpha * self.reference.standard_deviation,
            Tail::Upper => self.reference.mean,
        }
    }

    /// The share of each context's returns in a tail.
    pub fn tail_shares(&self, sample: &Sample, tail: Tail) -> Vec<f64> {
        let threshold = self.threshold(tail);
        let inside = |value: f64| match tail {
            Tail::Lower => value < threshold,
            Tail::Upper => value > threshold,
        };
        let share =
            |values: &Vec<f64>| values.iter().filter(|v| inside(**v)).count() as f64 / values.len() as f64;
        self.normal(sample).iter().map(share).collect()
    }

    /// Eq. 4.4: the mean over a set's options of `ψ`.
    ///
    /// # Errors
    /// Fewer than two contexts, a score that is not finite, or whatever keeps the metric from scoring.
    pub fn score(
        &self,
        metric: Box<dyn Metric>,
        sample: &Sample,
        judge: &dyn Judge,
    ) -> Result<Interval, RunError> {
        let members = sample.returns.first().map_or(0, Vec::len);
        let normal: Vec<Vec<f64>> = (0..members)
            .map(|m| sample.returns.iter().map(|values| self.scale.apply(values[m])).collect())
            .collect();
        let label = metric.label();
        let score = Score {
            metric,
            reference: self.reference,
            draws: self.plan.bootstrap_draws,
            seed: self.seed.clone(),
        };
        let scores = judge.scores(score, &normal)?;
        let of_set = |scores: &Vec<f64>| scores.iter().sum::<f64>() / scores.len() as f64;
        let of_sets: Vec<f64> = scores.iter().map(of_set).collect();
        interval_of(&of_sets, sample.returns.len(), self.plan.confidence).map_err(|error| {
            RunError::Config(format!("the score by {label} in held-out contexts has no interval: {error}"))
        })
    }

    /// The paired difference of two samples' mean returns.
    ///
    /// # Errors
    /// Samples of different contexts.
    pub fn compare(&self, ours: &Sample, baseline: &Sample) -> Result<Comparison, StatisticsError> {
        let ReportPlan { bootstrap_draws, confidence, .. } = *self.plan;
        let (first, second) = (ours.context_means(), baseline.context_means());
        let difference = paired_difference(&first, &second, bootstrap_draws, confidence, &mut self.stream())?;
        Ok(Comparison { baseline: baseline.name.clone(), difference })
    }

    /// Every statistic, whoever is looked at, meets the same resamples: a set that two metrics chose has the same figures
    /// under both, and what differs by a factor has intervals that do.
    pub fn stream(&self) -> Stream {
        self.seed.stream()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::judge::Here;

    fn rollout(value: f64, ending: Ending) -> Rollout {
        Rollout { term_sums: vec![value, 1.0], length: 10, ending, clamped: 0 }
    }

    #[test]
    fn figures_of_a_hand_worked_sample() {
        let plan = ReportPlan::default();
        let yardstick = Yardstick {
            scale: Scale { offset: 0.0, scale: 10.0 },
            reference: Reference { mean: 0.5, standard_deviation: 0.3 },
            plan: &plan,
            return_floor: -20.0,
            seed: Seed::root(1),
        };
        // Returns are term 0 less twice term 1. Member one: 1, 8; member two: 4, and a failure that counts as -20.
        let one = [rollout(3.0, Ending::Horizon), rollout(10.0, Ending::Terminated)];
        let two = [rollout(6.0, Ending::Horizon), rollout(99.0, Ending::Failed("lost".to_owned()))];
        let prices = vec![vec![1.0, -2.0]; 2];
        let sample = yardstick.sample("both", &[&one, &two], &prices);
        let row = yardstick.row(&sample).unwrap();
        // Context means 2.5 and -6; normalised tails below 0.2: {0.1}, {-2}; above 0.5: {}, {0.8}.
        assert!((row.mean_return.estimate - -1.75).abs() < 1e-12);
        assert!((row.mean.estimate - -0.175).abs() < 1e-12);
        assert_eq!((row.lower_tail.estimate, row.upper_tail.estimate), (0.5, 0.25));
        assert_eq!((row.falls.estimate, row.failures, row.mean_length), (0.25, 0.25, 10.0));
        let score = yardstick.score(Box::new(crate::metric::MaximumMean {}), &sample, &Here).unwrap();
        assert!((score.estimate - row.mean.estimate).abs() < 1e-12);
        let against = yardstick.compare(&sample, &yardstick.sample("one", &[&one], &prices)).unwrap();
        // Differences 2.5 - 1 and -6 - 8.
        assert!((against.difference.estimate - -6.25).abs() < 1e-12);

        // Under another name it has the same intervals.
        let renamed = yardstick.row(&yardstick.sample("again", &[&one, &two], &prices)).unwrap();
        assert_eq!(Row { name: row.name.clone(), ..renamed }, row);
        // The mean's interval is the return's over 10, and the score by ψ_μ is the mean.
        assert!((row.mean.low - row.mean_return.low / 10.0).abs() < 1e-12);
        assert!((score.high - row.mean.high).abs() < 1e-12);
    }
}
