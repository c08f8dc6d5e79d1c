//! The pattern page as the panel of a bench: a browser in full screen on the LCD.

use super::display::{Link, NotShown, PagePattern};
use async_trait::async_trait;
use nacre_drivers::{Class, Clock, DeviceError, DeviceResult, Display, DisplayInfo, Pattern, Shown};
use std::sync::Arc;
use std::time::Duration;

/// The panel behind the pattern page.
pub struct PagePanel {
    /// The way to the page.
    pub link: Arc<Link>,
    /// Width and height of the panel, in mm.
    pub size_mm: [f64; 2],
    /// Until a picture that was acknowledged is steady.
    pub response: Duration,
    /// The time that it reports.
    pub clock: Arc<dyn Clock>,
}

impl PagePanel {
    /// What a panel of this size is.
    pub fn info(size_mm: [f64; 2]) -> DisplayInfo {
        DisplayInfo { id: "pattern page /display".into(), size_mm }
    }
}

#[async_trait]
impl Display for PagePanel {
    fn describe(&self) -> DisplayInfo {
        Self::info(self.size_mm)
    }

    async fn show(&mut self, pattern: Pattern) -> DeviceResult<Shown> {
        let asked = match pattern {
            Pattern::Black => PagePattern::Black {},
            Pattern::Disc { center_mm, diameter_mm } => PagePattern::Disc { center_mm, diameter_mm },
        };
        match self.link.show(asked).await {
            Ok(()) => {}
            // A page that is not there, or hidden, is dark, and will be black when it comes back.
            Err(NotShown::NoPage | NotShown::Hidden) if pattern == Pattern::Black => {}
            Err(why) => {
                return Err(DeviceError::new(
                    &self.describe().id,
                    "show a pattern",
                    "its acknowledgement",
                    why.to_string(),
                )
                .remedy(format!("{}, then resume the session", why.remedy()))
                .class(if why == NotShown::Silent { Class::Retry } else { Class::Stop }));
            }
        }
        Ok(Shown { since: self.clock.now() + self.response, pattern })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nacre_drivers::SystemClock;

    #[test]
    fn nothing_is_shown_without_a_page_but_it_is_dark() {
        let mut panel = PagePanel {
            link: Arc::default(),
            size_mm: [500.0, 300.0],
            response: Duration::from_millis(30),
            clock: Arc::new(SystemClock),
        };
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        let before = SystemClock.now();
        let black = runtime.block_on(panel.show(Pattern::Black)).unwrap();
        assert!(black.since >= before + Duration::from_millis(30));
        let disc = Pattern::Disc { center_mm: [0.0, 0.0], diameter_mm: 50.0 };
        let error = runtime.block_on(panel.show(disc)).unwrap_err();
        assert!(error.got.contains("no pattern page") && error.remedy.contains("/display"), "{error}");
    }
}
