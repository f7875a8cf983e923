//! A wall in front of the vehicle, which its two wheels (motors 0 and 1) drive towards.
//!
//! The vehicle goes straight: as far as its wheels have gone in the mean. Where a wheel's counts
//! rise it goes forward, as the firmware takes it to (settings 21 and 22), whichever way its motor is
//! wired ([`MotorScene::reversed`](super::MotorScene::reversed)); the wheel of the other side that is
//! mounted the other way round has a negative [`cm_per_count`](super::Environment::cm_per_count).
//! Sensors 1 to 3 of the sonars and the infrared range look forward. At [`BUMPER_CM`] neither wheel
//! turns further forward, as in a jam; backwards both are free.

/// How near the vehicle comes to the wall.
pub const BUMPER_CM: f32 = 3.0;
/// The farthest wall there is.
pub const FARTHEST_CM: f32 = 10_000.0;
/// How many of the sonars look forward: sensors 1 to 3.
pub const SONARS_AHEAD: usize = 3;

/// A wall, and where the wheels were, in counts, when it was that far away.
#[derive(Clone, Copy, Debug)]
pub struct Wall {
    pub cm: f32,
    pub wheels: [i64; 2],
}

impl Wall {
    /// How far it is with the wheels there, in cm.
    pub fn distance_cm(&self, wheels: [i64; 2], cm_per_count: [f32; 2]) -> f32 {
        let gone = |i: usize| (wheels[i] - self.wheels[i]) as f32 * cm_per_count[i];
        (self.cm - (gone(0) + gone(1)) / 2.0).max(0.0)
    }
}

/// What an ultrasonic sensor reads of a wall: whole cm, 255 when it is out of range.
pub fn sonar_cm(distance_cm: f32) -> u8 {
    (distance_cm + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use firmware::ports::MotorOutput;
    use firmware::units::Duty;

    use crate::plant::{Plant, Scene};

    /// A vehicle before a wall, with these duties on its wheels.
    fn driven(scene: Scene, duties: [i32; 2]) -> Plant {
        let mut plant = Plant::new(scene, 1);
        drive(&mut plant, duties);
        plant
    }

    fn drive(plant: &mut Plant, duties: [i32; 2]) {
        for (output, raw) in plant.outputs.motors.iter_mut().zip(duties) {
            *output = MotorOutput { duty: Duty::from_raw(raw), enabled: true };
        }
    }

    fn before(wall_cm: f32) -> Scene {
        let mut scene = Scene::default();
        scene.environment.wall_cm = Some(wall_cm);
        scene
    }

    #[test]
    fn the_sonars_ahead_see_the_wall_come_nearer_by_whole_centimetres() {
        let mut plant = driven(before(60.0), [8192; 2]);
        plant.overrides.sonar_cm[1] = Some(77);
        let mut seen = vec![plant.sensors().sonar_cm];
        assert_eq!(seen[0], [60, 77, 60, 255, 255, 255]);
        for ms in 1..=1000 {
            plant.advance_to(ms);
            let sonars = plant.sensors().sonar_cm;
            assert!(sonars[0] == sonars[2] && sonars[1] == 77 && sonars[3..] == [255; 3]);
            if sonars != *seen.last().unwrap() {
                assert_eq!(seen.last().unwrap()[0] - sonars[0], 1);
                seen.push(sonars);
            }
        }
        // Half of full speed is 33 cm/s, less what the wheels need to get there.
        let last = seen.last().unwrap()[0];
        assert!((28..=33).contains(&last), "{last}");
    }

    #[test]
    fn what_is_nearer_than_the_wall_or_out_of_range_reads_as_without_it() {
        let mut scene = before(300.0);
        assert_eq!(Plant::new(scene, 1).sensors().sonar_cm, [255; 6]);
        scene.environment.sonar_cm = [90; 6];
        scene.environment.wall_cm = Some(50.6);
        assert_eq!(Plant::new(scene, 1).sensors().sonar_cm, [51, 51, 51, 90, 90, 90]);
        let infrared = |scene| Plant::new(scene, 1).sensors().ir_range;
        assert!((700..715).contains(&infrared(before(60.4))), "{}", infrared(before(60.4)));
        scene.environment.ir_range_cm = 20.0;
        assert!((1675..1682).contains(&infrared(scene)), "{}", infrared(scene));
    }

    #[test]
    fn the_wall_holds_the_wheels_as_a_jam_does_and_lets_them_back_off() {
        let mut plant = driven(before(20.0), [16_384; 2]);
        plant.advance_to(1000);
        let distance = plant.wall_cm().unwrap();
        assert!((2.9..=3.0).contains(&distance), "{distance}");
        assert_eq!(plant.motors[0].velocity(), 0.0);
        let currents = plant.motion_inputs().currents;
        assert!(currents[..2].iter().all(|current| (1900..2200).contains(current)), "{currents:?}");

        drive(&mut plant, [-8192; 2]);
        plant.advance_to(2000);
        let distance = plant.wall_cm().unwrap();
        assert!((25.0..36.0).contains(&distance), "{distance}");
    }

    #[test]
    fn a_wheel_that_is_mounted_the_other_way_round_goes_forward_with_falling_counts() {
        let mut scene = before(60.0);
        let turned = driven(scene, [8192, -8192]);
        scene.environment.cm_per_count[1] *= -1.0;
        let driven = driven(scene, [8192, -8192]);
        let [turned, driven] = [turned, driven].map(|mut plant| {
            plant.advance_to(5000);
            plant.wall_cm().unwrap()
        });
        assert!((59.0..61.0).contains(&turned), "on the spot: {turned}");
        assert!((2.9..=3.0).contains(&driven), "{driven}");
    }

    #[test]
    fn a_wall_is_put_ahead_of_where_the_vehicle_is_and_goes_back_to_the_scenes() {
        let mut plant = driven(before(100.0), [8192; 2]);
        plant.advance_to(1000);
        let scenes = plant.wall_cm().unwrap();
        assert!(scenes < 75.0);
        plant.place_wall(Some(40.0));
        assert_eq!((plant.wall_cm(), plant.placed_wall_cm()), (Some(40.0), Some(40.0)));
        plant.advance_to(1100);
        assert!(plant.wall_cm().unwrap() < 38.0);
        plant.place_wall(Some(40.0));
        assert_eq!(plant.wall_cm(), Some(40.0));
        plant.place_wall(None);
        assert!(plant.wall_cm().unwrap() < scenes && plant.placed_wall_cm().is_none());
        assert_eq!(Plant::new(Scene::default(), 1).wall_cm(), None);
    }
}
