//! Tests of whole reconstructions through files, against closed forms and simulated truth.

pub(crate) mod bracket;
pub(crate) mod plain;
pub(crate) mod precision;
pub(crate) mod repeats;
pub(crate) mod sensor;
