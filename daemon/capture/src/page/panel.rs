//! Panel of a bench realised by the pattern page: a full-screen browser on the LCD.

use super::{Link, NotShown, PagePattern};
use async_trait::async_trait;
use nacre_drivers::{Class, Clock, DeviceError, DeviceResult, Display, DisplayInfo, Pattern, Shown};
use std::sync::Arc;
use std::time::Duration;

/// A panel that uses the pattern page.
pub struct PagePanel {
    /// Connection to the page.
    pub link: Arc<Link>,
    /// Width and height of the panel in mm.
    pub size_mm: [f64; 2],
    /// Settling time after an acknowledgement.
    pub response: Duration,
    /// Clock of reported times.
    pub clock: Arc<dyn Clock>,
}

impl PagePanel {
    /// Description of a panel of this size.
    pub fn info(size_mm: [f64; 2]) -> DisplayInfo {
        DisplayInfo { id: "pattern page /display".into(), size_mm }
    }

    fn not_shown(&self, command: &str, why: NotShown) -> DeviceError {
        DeviceError::new(&self.describe().id, command, "its acknowledgement", why.to_string())
            .remedy(format!("{}, then resume the session", why.remedy()))
            .class(if why == NotShown::Silent { Class::Retry } else { Class::Stop })
    }
}

#[async_trait]
impl Display for PagePanel {
    fn describe(&self) -> DisplayInfo {
        Self::info(self.size_mm)
    }

    async fn show(&mut self, pattern: Pattern) -> DeviceResult<Shown> {
        let requested = match pattern {
            Pattern::Black => PagePattern::Black {},
            Pattern::Disc { center_mm, diameter_mm } => PagePattern::Disc { center_mm, diameter_mm },
            Pattern::Fringes { cycles_per_mm, phase, gamma } => PagePattern::Fringes { cycles_per_mm, phase, gamma },
        };
        self.link.show(requested).await.map_err(|why| self.not_shown("show a pattern", why))?;
        Ok(Shown { since: self.clock.now() + self.response, pattern })
    }

    /// A missing or hidden page emits no light, and will be black when it returns.
    async fn dark(&mut self) -> DeviceResult<Shown> {
        match self.link.show(PagePattern::Black {}).await {
            Ok(()) | Err(NotShown::NoPage | NotShown::Hidden) => {
                Ok(Shown { since: self.clock.now() + self.response, pattern: Pattern::Black })
            }
            Err(why) => Err(self.not_shown("go dark", why)),
        }
    }

    async fn still_shows(&mut self) -> DeviceResult<()> {
        self.link.still_shows().map_err(|why| self.not_shown("go on showing the pattern", why))
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
        let dark = runtime.block_on(panel.dark()).unwrap();
        assert!(dark.since >= before + Duration::from_millis(30));
        // A pattern must be visible for a frame, even a black one.
        for pattern in [Pattern::Black, Pattern::Disc { center_mm: [0.0, 0.0], diameter_mm: 50.0 }] {
            let error = runtime.block_on(panel.show(pattern)).unwrap_err();
            assert!(error.got.contains("no pattern page") && error.remedy.contains("/display"), "{error}");
        }
        assert!(runtime.block_on(panel.still_shows()).is_err());
    }
}
