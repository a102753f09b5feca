//! For tests: the network once more, as slowly and plainly as possible, in double precision; and finite differences.

/// The network's output for one input of single precision; see [`forward_f64`].
pub(crate) fn forward(sizes: &[usize], params: &[f64], input: &[f32]) -> Vec<f64> {
    let input: Vec<f64> = input.iter().map(|&x| f64::from(x)).collect();
    forward_f64(sizes, params, &input)
}

/// The network's output for one input. Parameters lie as `Mlp` documents.
pub(super) fn forward_f64(sizes: &[usize], params: &[f64], input: &[f64]) -> Vec<f64> {
    let mut values = input.to_vec();
    let mut start = 0;
    for (index, pair) in sizes.windows(2).enumerate() {
        let (inputs, outputs) = (pair[0], pair[1]);
        let biases = start + inputs * outputs;
        let sums = (0..outputs).map(|o| {
            let products = (0..inputs).map(|i| values[i] * params[start + i * outputs + o]);
            params[biases + o] + products.sum::<f64>()
        });
        let hidden = index + 2 < sizes.len();
        let next = sums.map(|sum| if hidden { sum.tanh() } else { sum }).collect();
        values = next;
        start = biases + outputs;
    }
    values
}

/// Central differences of `loss` by the numbers at `indices` of `point`.
pub(crate) fn differences(point: &[f64], indices: &[usize], loss: impl Fn(&[f64]) -> f64) -> Vec<f64> {
    let step = 1e-5;
    let mut moved = point.to_vec();
    indices
        .iter()
        .map(|&i| {
            moved[i] = point[i] + step;
            let above = loss(&moved);
            moved[i] = point[i] - step;
            let below = loss(&moved);
            moved[i] = point[i];
            (above - below) / (2.0 * step)
        })
        .collect()
}

/// Euclidean length of the difference of two tensors over that of the exact one.
pub(crate) fn relative_error(got: &[f32], exact: &[f64]) -> f64 {
    assert_eq!(got.len(), exact.len());
    let error: f64 = got.iter().zip(exact).map(|(&g, e)| (f64::from(g) - e).powi(2)).sum();
    let length: f64 = exact.iter().map(|e| e * e).sum();
    (error / length).sqrt()
}
