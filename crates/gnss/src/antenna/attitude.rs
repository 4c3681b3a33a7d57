//! Attitude of a platform against the horizon.

use crate::checked;
use nalgebra::{Matrix3, Rotation3, Vector3};
use serde::{Deserialize, Serialize};

/// Attitude of a platform: its axes right, forward and up start as east, north and up; then it rolls
/// about forward, pitches about right, and yaws about up. Degrees.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Attitude {
    /// Azimuth of forward, from north over east.
    #[serde(deserialize_with = "checked::finite")]
    pub yaw_deg: f64,
    /// Elevation of forward.
    #[serde(deserialize_with = "checked::finite")]
    pub pitch_deg: f64,
    /// Right-handed turn about forward: positive when the right side is lower than the left.
    #[serde(deserialize_with = "checked::finite")]
    pub roll_deg: f64,
}

impl Attitude {
    /// The rotation that takes (right, forward, up) of the platform to (east, north, up).
    pub fn to_enu(&self) -> Matrix3<f64> {
        let turn = |axis, degrees: f64| Rotation3::from_axis_angle(&axis, degrees.to_radians());
        let yaw = turn(Vector3::z_axis(), -self.yaw_deg);
        let pitch = turn(Vector3::x_axis(), self.pitch_deg);
        let roll = turn(Vector3::y_axis(), self.roll_deg);
        (yaw * pitch * roll).into_inner()
    }

    /// The attitude of a rotation from (right, forward, up) to (east, north, up); with forward upright, where yaw and
    /// roll are one turn, all of it is yaw.
    pub fn of(to_enu: &Matrix3<f64>) -> Self {
        let [right, forward, up] = [0, 1, 2].map(|k| to_enu.column(k).into_owned());
        let pitch_deg = forward.z.clamp(-1.0, 1.0).asin().to_degrees();
        if forward.xy().norm() < 1e-9 {
            let yaw_deg = (-right.y).atan2(right.x).to_degrees();
            return Self { yaw_deg, pitch_deg, roll_deg: 0.0 };
        }
        let yaw_deg = forward.x.atan2(forward.y).to_degrees();
        Self { yaw_deg, pitch_deg, roll_deg: (-right.z).atan2(up.z).to_degrees() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_attitude_follows_from_its_rotation() {
        for (yaw_deg, pitch_deg, roll_deg) in
            [(30.0, 20.0, 10.0), (-170.0, -60.0, 100.0), (50.0, 90.0, 0.0)]
        {
            let attitude = Attitude { yaw_deg, pitch_deg, roll_deg };
            let again = Attitude::of(&attitude.to_enu()).to_enu();
            assert!((again - attitude.to_enu()).norm() < 1e-9);
        }
    }

    #[test]
    fn the_axes_go_where_yaw_pitch_and_roll_say() {
        let axes = |yaw_deg, pitch_deg, roll_deg| {
            let m = Attitude { yaw_deg, pitch_deg, roll_deg }.to_enu();
            [0, 1, 2].map(|k| m.column(k).into_owned())
        };
        let near = |a: Vector3<f64>, b: [f64; 3]| (a - Vector3::from(b)).norm() < 1e-15;
        let [right, forward, up] = axes(90.0, 0.0, 0.0);
        assert!(near(forward, [1.0, 0.0, 0.0]) && near(right, [0.0, -1.0, 0.0]));
        assert!(near(up, [0.0, 0.0, 1.0]));
        let half = 0.5f64.sqrt();
        let [right, forward, _] = axes(0.0, 45.0, 0.0);
        assert!(near(forward, [0.0, half, half]) && near(right, [1.0, 0.0, 0.0]));
        let [right, forward, up] = axes(0.0, 0.0, 90.0);
        assert!(near(right, [0.0, 0.0, -1.0]) && near(forward, [0.0, 1.0, 0.0]));
        assert!(near(up, [1.0, 0.0, 0.0]));
        // Forward at azimuth 30, elevation 20, whatever the roll; and right is lower by sin(roll) cos(pitch).
        let [right, forward, _] = axes(30.0, 20.0, 10.0);
        let direction = super::super::direction(30f64.to_radians(), 20f64.to_radians());
        assert!((forward - direction.into_inner()).norm() < 1e-15);
        let lower = 10f64.to_radians().sin() * 20f64.to_radians().cos();
        assert!((right.z + lower).abs() < 1e-15);
    }
}
