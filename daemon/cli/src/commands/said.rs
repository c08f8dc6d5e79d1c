//! What results of all kinds end with: assumptions, warnings, and whether they are as good as was asked for.

use nacre_capture::Failure;

/// A line for each.
pub fn lines(assumptions: &[String], warnings: &[String]) -> String {
    let assumed = assumptions.iter().map(|a| format!("assumed   {a}\n"));
    assumed.chain(warnings.iter().map(|w| format!("warning   {w}\n"))).collect()
}

/// Fails where an error is larger than was asked for, in this unit, or cannot be told. `error` names it, `remedy` says what makes it smaller.
pub fn meets(wanted: Option<f64>, found: Option<f64>, [error, unit, remedy]: [&str; 3]) -> Result<(), Failure> {
    match (wanted, found) {
        (None, _) => Ok(()),
        (Some(wanted), Some(found)) if found <= wanted => Ok(()),
        (Some(wanted), Some(found)) => Err(Failure::Bound(format!(
            "{error} is {found:.4}{unit}, more than the {wanted}{unit} asked for; {remedy}"
        ))),
        (Some(wanted), None) => {
            Err(Failure::Bound(format!("no error can be told, so it may exceed the {wanted}{unit} asked for")))
        }
    }
}
