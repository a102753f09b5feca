//! Copies of tensors with one thing wrong, for readers that must refuse them.

use super::check::Violation;
use crate::tensors::{Tensor, TensorError, Tensors};

/// A damaged copy, and what is wrong with it.
pub(super) type Damaged = (String, Tensors);

/// Asks that `load` refuses each copy, or that `harmless` can say why what it made of the copy is right.
pub(super) fn demand_refusals<P: ?Sized>(
    copies: Vec<Damaged>,
    load: impl Fn(&Tensors) -> Result<Box<P>, TensorError>,
    harmless: impl Fn(&P, &Tensors) -> Result<(), Violation>,
) -> Result<(), Violation> {
    for (what, tensors) in copies {
        if let Ok(policy) = load(&tensors) {
            harmless(&policy, &tensors).map_err(|violation| violation.during(format!("loaded {what}")))?;
        }
    }
    Ok(())
}

/// The `harmless` of [`demand_refusals`] for damage that is never right.
pub(super) fn never<P: ?Sized>(_: &P, _: &Tensors) -> Result<(), Violation> {
    Err(Violation::new("load", "an error", "a policy"))
}

/// Copies that lack one tensor each.
pub(super) fn missing(tensors: &Tensors) -> Vec<Damaged> {
    tensors
        .iter()
        .map(|(name, _)| (format!("without tensor `{name}`"), replaced(tensors, name, None)))
        .collect()
}

/// Copies with one number that is not finite, in the first and in the last place of each tensor.
pub(super) fn spoilt(tensors: &Tensors) -> Vec<Damaged> {
    let mut found = Vec::new();
    for (name, tensor) in tensors.iter() {
        let Some(last) = tensor.data.len().checked_sub(1) else { continue };
        for (place, value) in [(0, f32::NAN), (last, f32::NAN), (0, f32::INFINITY), (last, f32::NEG_INFINITY)]
        {
            let mut tensor = tensor.clone();
            tensor.data[place] = value;
            let what = format!("with {value} at place {place} of tensor `{name}`");
            found.push((what, replaced(tensors, name, Some(tensor))));
        }
    }
    found
}

/// Copies in which one axis of one tensor is a row longer, a row shorter or empty, or in which one tensor has an axis
/// more or all its axes in one.
pub(super) fn misshapen(tensors: &Tensors) -> Vec<Damaged> {
    let mut found = Vec::new();
    for (name, tensor) in tensors.iter() {
        let mut shapes = vec![[&[1], tensor.shape.as_slice()].concat()];
        if tensor.shape.len() > 1 {
            shapes.push(vec![tensor.data.len()]);
        }
        for axis in 0..tensor.shape.len() {
            let extent = tensor.shape[axis];
            for other in [extent + 1, extent.saturating_sub(1), 0] {
                let mut shape = tensor.shape.clone();
                shape[axis] = other;
                shapes.push(shape);
            }
        }
        shapes.retain(|shape| *shape != tensor.shape);
        for shape in shapes {
            let length = shape.iter().product();
            let mut data = tensor.data.clone();
            data.resize(length, 0.0);
            let what = format!("with shape {shape:?} of tensor `{name}` in place of {:?}", tensor.shape);
            found.push((what, replaced(tensors, name, Some(Tensor { shape, data }))));
        }
    }
    found
}

/// `tensors` with another tensor called `name`, or none.
fn replaced(tensors: &Tensors, name: &str, other: Option<Tensor>) -> Tensors {
    let mut copy = Tensors::new();
    for (kept, tensor) in tensors.iter().filter(|(kept, _)| *kept != name) {
        copy.insert(kept, &tensor.shape, tensor.data.clone());
    }
    if let Some(tensor) = other {
        copy.insert(name, &tensor.shape, tensor.data);
    }
    copy
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_copy_differs_from_the_original_in_one_tensor() {
        let mut tensors = Tensors::new();
        tensors.insert("a", &[2, 1], vec![1.0, 2.0]);
        tensors.insert("b", &[1], vec![3.0]);
        assert_eq!(missing(&tensors).len(), 2);
        // Four spoilt copies of each. Of `a`: [1,2,1], [2], [3,1], [1,1], [0,1], [2,2], [2,0] and [2,0] again.
        assert_eq!(spoilt(&tensors).len(), 8);
        // Of `b`: [1,1], [2], [0] and [0] again.
        assert_eq!(misshapen(&tensors).len(), 8 + 4);
        for (what, copy) in [missing(&tensors), spoilt(&tensors), misshapen(&tensors)].concat() {
            let changed =
                tensors.iter().filter(|(name, tensor)| copy.get(name).ok() != Some(*tensor)).count();
            assert_eq!(changed, 1, "{what}");
        }
    }
}
