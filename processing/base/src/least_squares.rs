//! Nonlinear least squares by the Levenberg-Marquardt method.

/// Schedule of the damping: the term added to the diagonal of the normal matrix, relative to that diagonal.
#[derive(Clone, Copy, Debug)]
pub struct Damping {
    /// Damping of the first step.
    pub first: f64,
    /// Factor after an accepted step.
    pub down: f64,
    /// Lower bound.
    pub least: f64,
    /// Factor after a rejected step.
    pub up: f64,
    /// Upper bound; the search ends above it.
    pub most: f64,
}

/// Outcome of an attempted step.
pub enum Step<S> {
    /// New state, to be compared with the current one.
    Trial(S),
    /// The damped normal matrix is singular: increase the damping.
    Singular,
    /// No further step is possible.
    End,
}

/// A least-squares problem.
pub trait Problem {
    /// Parameters and derived quantities such as residuals and normal matrix.
    type State;
    /// Reason to abort the search.
    type Error;

    /// Sum of squares, or another cost with a positive normal matrix.
    fn cost(&self, state: &Self::State) -> f64;

    /// Computes the damped step from a state.
    ///
    /// # Errors
    /// Aborts the search.
    fn step(&self, from: &Self::State, damping: f64) -> Result<Step<Self::State>, Self::Error>;

    /// Called for a step that does not increase the cost: completes the new state, and returns true on convergence.
    fn accept(&self, from: &Self::State, to: &mut Self::State) -> bool;
}

/// Minimises the cost in at most `steps` attempted steps; returns the best state.
///
/// # Errors
/// Those of [`Problem::step`].
pub fn levenberg_marquardt<P: Problem>(
    problem: &P,
    start: P::State,
    schedule: Damping,
    steps: usize,
) -> Result<P::State, P::Error> {
    let (mut state, mut damping) = (start, schedule.first);
    for _ in 0..steps {
        match problem.step(&state, damping)? {
            Step::End => break,
            Step::Trial(mut trial) if problem.cost(&trial) <= problem.cost(&state) => {
                let converged = problem.accept(&state, &mut trial);
                state = trial;
                damping = (damping * schedule.down).max(schedule.least);
                if converged {
                    break;
                }
            }
            Step::Trial(_) | Step::Singular => {
                damping *= schedule.up;
                if damping > schedule.most {
                    break;
                }
            }
        }
    }
    Ok(state)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::convert::Infallible;

    /// Rosenbrock's valley as residuals (1 - x, 10 (y - x²)); the minimum is at (1, 1).
    struct Valley;

    impl Problem for Valley {
        type State = [f64; 2];
        type Error = Infallible;

        fn cost(&self, [x, y]: &[f64; 2]) -> f64 {
            (1.0 - x).powi(2) + 100.0 * (y - x * x).powi(2)
        }

        fn step(&self, [x, y]: &[f64; 2], damping: f64) -> Result<Step<[f64; 2]>, Infallible> {
            let residuals = [1.0 - x, 10.0 * (y - x * x)];
            // Derivatives of the model; the residuals are its negative.
            let by_x = [1.0, 20.0 * x];
            let by_y = [0.0, -10.0];
            let dot = |a: [f64; 2], b: [f64; 2]| a[0] * b[0] + a[1] * b[1];
            let [xx, xy, yy] = [dot(by_x, by_x) * (1.0 + damping), dot(by_x, by_y), dot(by_y, by_y) * (1.0 + damping)];
            let [rx, ry] = [dot(by_x, residuals), dot(by_y, residuals)];
            let det = xx * yy - xy * xy;
            Ok(Step::Trial([x + (yy * rx - xy * ry) / det, y + (xx * ry - xy * rx) / det]))
        }

        fn accept(&self, from: &[f64; 2], to: &mut [f64; 2]) -> bool {
            self.cost(from) - self.cost(to) < 1e-24
        }
    }

    #[test]
    fn the_bottom_of_a_valley_is_found() {
        let damping = Damping { first: 1e-3, down: 0.1, least: 0.0, up: 10.0, most: 1e12 };
        let Ok([x, y]) = levenberg_marquardt(&Valley, [-1.2, 1.0], damping, 100);
        assert!((x - 1.0).abs() < 1e-9 && (y - 1.0).abs() < 1e-9, "{x} {y}");
        let Ok(near) = levenberg_marquardt(&Valley, [-1.2, 1.0], damping, 3);
        assert!(Valley.cost(&near) < Valley.cost(&[-1.2, 1.0]) && near[0] < 1.0);
    }

    /// A singular problem ends by the damping's upper bound, not by the number of steps.
    #[test]
    fn a_singular_problem_ends() {
        struct Singular(std::cell::Cell<usize>);
        impl Problem for Singular {
            type State = ();
            type Error = Infallible;
            fn cost(&self, (): &()) -> f64 {
                0.0
            }
            fn step(&self, (): &(), _: f64) -> Result<Step<()>, Infallible> {
                self.0.set(self.0.get() + 1);
                Ok(Step::Singular)
            }
            fn accept(&self, (): &(), (): &mut ()) -> bool {
                false
            }
        }
        let problem = Singular(0.into());
        let damping = Damping { first: 1.0, down: 0.1, least: 0.0, up: 10.0, most: 1e3 };
        let Ok(()) = levenberg_marquardt(&problem, (), damping, usize::MAX);
        assert_eq!(problem.0.get(), 4);
    }
}
