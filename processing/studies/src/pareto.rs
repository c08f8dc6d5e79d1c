//! Pareto-optimal settings.

/// Positions of the Pareto-optimal points `(cost, error)`, by increasing cost. Points with NaN are excluded; of equal
/// points the first is kept.
pub fn pareto_front(points: &[(f64, f64)]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len()).filter(|&i| !points[i].0.is_nan() && !points[i].1.is_nan()).collect();
    order.sort_by(|&a, &b| {
        let ((ca, ea), (cb, eb)) = (points[a], points[b]);
        ca.total_cmp(&cb).then(ea.total_cmp(&eb)).then(a.cmp(&b))
    });
    let mut best = f64::INFINITY;
    order.retain(|&i| {
        let better = points[i].1 < best;
        best = best.min(points[i].1);
        better
    });
    order
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn dominated_points_are_left_out() {
        let points = [(1.0, 9.0), (2.0, 3.0), (2.0, 4.0), (3.0, 5.0), (4.0, 1.0), (f64::NAN, 0.0), (4.0, 1.0)];
        assert_eq!(pareto_front(&points), [0, 1, 4]);
        assert!(pareto_front(&[(1.0, f64::NAN)]).is_empty());
    }

    proptest! {
        /// A point is on the front exactly if no other point is as good in both coordinates and better in one (checked
        /// pairwise).
        #[test]
        fn it_is_the_definition(points in prop::collection::vec((0u8..20, 0u8..20), 0..40)) {
            let points: Vec<(f64, f64)> = points.into_iter().map(|(c, e)| (c.into(), e.into())).collect();
            let front = pareto_front(&points);
            for (i, p) in points.iter().enumerate() {
                let beaten = points.iter().any(|q| q.0 <= p.0 && q.1 <= p.1 && q != p);
                let twin = points[..i].contains(p);
                prop_assert_eq!(front.contains(&i), !beaten && !twin);
            }
        }
    }
}
