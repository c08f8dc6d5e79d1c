//! An Alpaca server with a rotator, a camera and switches, for tests of Nacre's drivers.
//!
//! `alpaca-server ADDRESS:PORT [ID]`; ID is part of the devices' identifiers.
//!
//! The camera sees a gradient of polarized light through the analyser on the rotator. Pixel (x, y) of an exposure of
//! t s has the code 200 + (20 x + 300 y) · t / 0.01 s · m, with m = (1 + 0.5 cos 2(angle - 30°)) / 1.5. Switch 1 is a
//! lamp, which doubles the signal.

use ascom_alpaca::api::camera::{CameraState, ImageArray};
use ascom_alpaca::api::{Camera, Device, Rotator, ServerInfo, Switch};
use ascom_alpaca::{ASCOMError, ASCOMResult, Server};
use async_trait::async_trait;
use ndarray::Array2;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

const SPEED_DEG_S: f64 = 180.0;
const COLUMNS: u32 = 320;
const ROWS: u32 = 200;

/// The state of all devices.
#[derive(Debug)]
struct World {
    id: String,
    connected: [bool; 3],
    from_deg: f64,
    to_deg: f64,
    began: Instant,
    reversed: bool,
    region: [u32; 4],
    gain: i32,
    exposure: Option<Exposure>,
    last: Option<Exposure>,
    switches: [f64; 2],
}

#[derive(Clone, Copy, Debug)]
struct Exposure {
    began: Instant,
    time: Duration,
    light: bool,
    angle_deg: f64,
    lamp: bool,
}

impl World {
    fn angle_deg(&self) -> f64 {
        let way = self.to_deg - self.from_deg;
        let gone = SPEED_DEG_S * self.began.elapsed().as_secs_f64();
        if gone >= way.abs() { self.to_deg } else { self.from_deg + gone.copysign(way) }
    }

    fn go(&mut self, to_deg: f64) -> ASCOMResult<()> {
        if !(0.0..360.0).contains(&to_deg) {
            return Err(ASCOMError::invalid_value(format!("{to_deg} is not from 0 to 360")));
        }
        (self.from_deg, self.to_deg, self.began) = (self.angle_deg(), to_deg, Instant::now());
        Ok(())
    }

    fn picture(&self, exposure: Exposure) -> ImageArray {
        let [left, top, width, height] = self.region;
        let malus = (1.0 + 0.5 * (2.0 * (exposure.angle_deg - 30.0).to_radians()).cos()) / 1.5;
        let lamp = if exposure.lamp { 2.0 } else { 1.0 };
        let factor = if exposure.light { lamp * malus * exposure.time.as_secs_f64() / 0.01 } else { 0.0 };
        Array2::from_shape_fn([width as usize, height as usize], |(x, y)| {
            let (x, y) = (left as usize + x, top as usize + y);
            (200.0 + factor * (20 * x + 300 * y) as f64).round().min(65_535.0) as u16
        })
        .into()
    }
}

type Shared = Arc<Mutex<World>>;

macro_rules! device {
    ($name:ident, $number:literal, $words:literal) => {
        #[derive(Debug)]
        struct $name(Shared, String);

        impl $name {
            fn new(world: &Shared) -> Self {
                let id = format!("{}-{}", stringify!($name), world.lock().unwrap().id);
                Self(world.clone(), id)
            }

            fn world(&self) -> ASCOMResult<std::sync::MutexGuard<'_, World>> {
                let world = self.0.lock().unwrap();
                if world.connected[$number] { Ok(world) } else { Err(ASCOMError::NOT_CONNECTED) }
            }
        }

        #[async_trait]
        impl Device for $name {
            fn static_name(&self) -> &str {
                $words
            }

            fn unique_id(&self) -> &str {
                &self.1
            }

            async fn connected(&self) -> ASCOMResult<bool> {
                Ok(self.0.lock().unwrap().connected[$number])
            }

            async fn set_connected(&self, connected: bool) -> ASCOMResult<()> {
                self.0.lock().unwrap().connected[$number] = connected;
                Ok(())
            }

            async fn description(&self) -> ASCOMResult<String> {
                Ok($words.into())
            }

            async fn driver_info(&self) -> ASCOMResult<String> {
                Ok("for tests of Nacre".into())
            }

            async fn driver_version(&self) -> ASCOMResult<String> {
                Ok("0".into())
            }
        }
    };
}
device!(Turner, 0, "Test rotator");
device!(Eye, 1, "Test camera");
device!(Board, 2, "Test switches");

#[async_trait]
impl Rotator for Turner {
    async fn can_reverse(&self) -> ASCOMResult<bool> {
        Ok(true)
    }

    async fn is_moving(&self) -> ASCOMResult<bool> {
        let world = self.world()?;
        Ok(world.angle_deg() != world.to_deg)
    }

    async fn mechanical_position(&self) -> ASCOMResult<f64> {
        Ok(self.world()?.angle_deg())
    }

    /// Offset by a synchronisation, which the mechanical angle is not.
    async fn position(&self) -> ASCOMResult<f64> {
        Ok((self.world()?.angle_deg() + 77.0).rem_euclid(360.0))
    }

    async fn reverse(&self) -> ASCOMResult<bool> {
        Ok(self.world()?.reversed)
    }

    async fn set_reverse(&self, reverse: bool) -> ASCOMResult<()> {
        self.world()?.reversed = reverse;
        Ok(())
    }

    async fn step_size(&self) -> ASCOMResult<f64> {
        Ok(0.01)
    }

    async fn target_position(&self) -> ASCOMResult<f64> {
        Ok(self.world()?.to_deg)
    }

    async fn halt(&self) -> ASCOMResult<()> {
        let mut world = self.world()?;
        let at = world.angle_deg();
        (world.from_deg, world.to_deg) = (at, at);
        Ok(())
    }

    async fn move_(&self, by_deg: f64) -> ASCOMResult<()> {
        let mut world = self.world()?;
        let to_deg = (world.angle_deg() + by_deg).rem_euclid(360.0);
        world.go(to_deg)
    }

    async fn move_absolute(&self, to_deg: f64) -> ASCOMResult<()> {
        self.world()?.go((to_deg - 77.0).rem_euclid(360.0))
    }

    async fn move_mechanical(&self, to_deg: f64) -> ASCOMResult<()> {
        self.world()?.go(to_deg)
    }

    async fn sync(&self, _: f64) -> ASCOMResult<()> {
        Err(ASCOMError::NOT_IMPLEMENTED)
    }
}

#[async_trait]
impl Camera for Eye {
    async fn bin_x(&self) -> ASCOMResult<u8> {
        Ok(1)
    }

    async fn bin_y(&self) -> ASCOMResult<u8> {
        Ok(1)
    }

    async fn camera_state(&self) -> ASCOMResult<CameraState> {
        let exposes = self.world()?.exposure.is_some_and(|e| e.began.elapsed() < e.time);
        Ok(if exposes { CameraState::Exposing } else { CameraState::Idle })
    }

    async fn camera_x_size(&self) -> ASCOMResult<u32> {
        Ok(COLUMNS)
    }

    async fn camera_y_size(&self) -> ASCOMResult<u32> {
        Ok(ROWS)
    }

    async fn can_abort_exposure(&self) -> ASCOMResult<bool> {
        Ok(true)
    }

    async fn abort_exposure(&self) -> ASCOMResult<()> {
        self.world()?.exposure = None;
        Ok(())
    }

    async fn ccd_temperature(&self) -> ASCOMResult<f64> {
        Ok(21.5)
    }

    async fn cooler_on(&self) -> ASCOMResult<bool> {
        Ok(false)
    }

    async fn exposure_max(&self) -> ASCOMResult<Duration> {
        Ok(Duration::from_secs(60))
    }

    async fn exposure_min(&self) -> ASCOMResult<Duration> {
        Ok(Duration::from_millis(1))
    }

    async fn exposure_resolution(&self) -> ASCOMResult<Duration> {
        Ok(Duration::from_micros(100))
    }

    async fn gain(&self) -> ASCOMResult<i32> {
        Ok(self.world()?.gain)
    }

    async fn set_gain(&self, gain: i32) -> ASCOMResult<()> {
        self.world()?.gain = gain;
        Ok(())
    }

    async fn gain_min(&self) -> ASCOMResult<i32> {
        Ok(0)
    }

    async fn gain_max(&self) -> ASCOMResult<i32> {
        Ok(400)
    }

    async fn has_shutter(&self) -> ASCOMResult<bool> {
        Ok(true)
    }

    async fn image_ready(&self) -> ASCOMResult<bool> {
        Ok(self.world()?.exposure.is_some_and(|e| e.began.elapsed() >= e.time))
    }

    async fn image_array(&self) -> ASCOMResult<ImageArray> {
        let mut world = self.world()?;
        let ready = world.exposure.filter(|e| e.began.elapsed() >= e.time);
        let exposure = ready.ok_or_else(|| ASCOMError::invalid_operation("no picture is ready"))?;
        world.last = Some(exposure);
        Ok(world.picture(exposure))
    }

    async fn last_exposure_duration(&self) -> ASCOMResult<Duration> {
        self.world()?.last.map(|e| e.time).ok_or_else(|| ASCOMError::invalid_operation("no exposure yet"))
    }

    async fn max_adu(&self) -> ASCOMResult<u32> {
        Ok(65_535)
    }

    async fn num_x(&self) -> ASCOMResult<u32> {
        Ok(self.world()?.region[2])
    }

    async fn set_num_x(&self, width: u32) -> ASCOMResult<()> {
        self.world()?.region[2] = width;
        Ok(())
    }

    async fn num_y(&self) -> ASCOMResult<u32> {
        Ok(self.world()?.region[3])
    }

    async fn set_num_y(&self, height: u32) -> ASCOMResult<()> {
        self.world()?.region[3] = height;
        Ok(())
    }

    async fn pixel_size_x(&self) -> ASCOMResult<f64> {
        Ok(3.76)
    }

    async fn pixel_size_y(&self) -> ASCOMResult<f64> {
        Ok(3.76)
    }

    async fn readout_modes(&self) -> ASCOMResult<Vec<String>> {
        Ok(vec!["Standard".into()])
    }

    async fn start_x(&self) -> ASCOMResult<u32> {
        Ok(self.world()?.region[0])
    }

    async fn set_start_x(&self, left: u32) -> ASCOMResult<()> {
        self.world()?.region[0] = left;
        Ok(())
    }

    async fn start_y(&self) -> ASCOMResult<u32> {
        Ok(self.world()?.region[1])
    }

    async fn set_start_y(&self, top: u32) -> ASCOMResult<()> {
        self.world()?.region[1] = top;
        Ok(())
    }

    async fn start_exposure(&self, time: Duration, light: bool) -> ASCOMResult<()> {
        let mut world = self.world()?;
        let [left, top, width, height] = world.region;
        if left + width > COLUMNS || top + height > ROWS {
            return Err(ASCOMError::invalid_value("the region lies beyond the sensor"));
        }
        if world.exposure.is_some_and(|e| e.began.elapsed() < e.time) {
            return Err(ASCOMError::invalid_operation("an exposure is in progress"));
        }
        let (angle_deg, lamp) = (world.angle_deg(), world.switches[1] > 0.0);
        world.exposure = Some(Exposure { began: Instant::now(), time, light, angle_deg, lamp });
        Ok(())
    }
}

#[async_trait]
impl Switch for Board {
    async fn max_switch(&self) -> ASCOMResult<usize> {
        Ok(3)
    }

    /// Switch 2 is an input.
    async fn can_write(&self, id: usize) -> ASCOMResult<bool> {
        Ok(id < 2)
    }

    async fn get_switch(&self, id: usize) -> ASCOMResult<bool> {
        Ok(self.get_switch_value(id).await? > 0.0)
    }

    async fn get_switch_description(&self, id: usize) -> ASCOMResult<String> {
        Ok(format!("switch {id}"))
    }

    async fn get_switch_name(&self, id: usize) -> ASCOMResult<String> {
        Ok(format!("switch {id}"))
    }

    async fn get_switch_value(&self, id: usize) -> ASCOMResult<f64> {
        let value = self.world()?.switches.get(id).copied();
        value.ok_or_else(|| ASCOMError::invalid_value("no such switch"))
    }

    async fn min_switch_value(&self, _: usize) -> ASCOMResult<f64> {
        Ok(0.0)
    }

    async fn max_switch_value(&self, id: usize) -> ASCOMResult<f64> {
        Ok(if id == 1 { 100.0 } else { 1.0 })
    }

    async fn set_switch(&self, id: usize, state: bool) -> ASCOMResult<()> {
        let value = if state { self.max_switch_value(id).await? } else { 0.0 };
        self.set_switch_value(id, value).await
    }

    async fn set_switch_value(&self, id: usize, value: f64) -> ASCOMResult<()> {
        let mut world = self.world()?;
        *world.switches.get_mut(id).ok_or_else(|| ASCOMError::invalid_value("no such switch"))? = value;
        Ok(())
    }

    async fn state_change_complete(&self, _: usize) -> ASCOMResult<bool> {
        Ok(true)
    }

    async fn switch_step(&self, _: usize) -> ASCOMResult<f64> {
        Ok(1.0)
    }
}

#[tokio::main]
async fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut words = std::env::args().skip(1);
    let address = words.next().ok_or("usage: alpaca-server ADDRESS:PORT [ID]")?.parse()?;
    let world = Arc::new(Mutex::new(World {
        id: words.next().unwrap_or_else(|| "0".into()),
        connected: [false; 3],
        from_deg: 0.0,
        to_deg: 0.0,
        began: Instant::now(),
        reversed: true,
        region: [0, 0, COLUMNS / 2, ROWS / 2],
        gain: 100,
        exposure: None,
        last: None,
        switches: [0.0; 2],
    }));
    let mut server = Server::new(ServerInfo {
        server_name: "Alpaca server of Nacre's tests".into(),
        manufacturer: "Nacre".into(),
        manufacturer_version: "0".into(),
        location: "a test".into(),
    });
    server.listen_addr = address;
    server.devices.register(Turner::new(&world));
    server.devices.register(Eye::new(&world));
    server.devices.register(Board::new(&world));
    match server.start().await {
        Ok(never) => match never {},
        Err(error) => Err(error.into()),
    }
}
