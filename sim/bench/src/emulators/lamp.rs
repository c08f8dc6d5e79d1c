//! The bench's flash as the load of an emulated device.

use crate::devices::Port;
use crate::messages::Request;

/// Output switched by an emulated device.
pub(super) struct Load {
    port: Box<dyn Port>,
    on: bool,
}

impl Load {
    /// The bench's flash, switched off.
    pub fn new(port: Box<dyn Port>) -> Self {
        let mut load = Self { port, on: true };
        load.set(false);
        load
    }

    /// Switches the flash if its state differs. If the bench cannot be reached, the state stays.
    pub fn set(&mut self, on: bool) {
        if self.on != on && self.port.call(&Request::Switch { on }).is_ok() {
            self.on = on;
        }
    }

    /// Whether it is on.
    pub fn is_on(&self) -> bool {
        self.on
    }
}
