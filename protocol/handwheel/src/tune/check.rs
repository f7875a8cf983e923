//! Is it wired as it should be? A moment of a low duty each way, before any loop is closed.

use std::time::Duration;

use protocol::extension::ChannelState;

use super::hand::Hand;
use super::job::{Job, Refused, set_back};
use super::procedure::{Before, POLARITY, duty_of, numbered};
use crate::number::Number;

/// What one way showed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Way {
    /// Counts, positive if they went as they should.
    pub moved: i32,
    /// A/D counts of current above those at rest.
    pub current: i32,
    /// The highest duty that was driven, 0 to 1.
    pub duty: f64,
}

/// What a check has found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Checked {
    /// With rising counts, and with falling ones.
    pub ways: [Way; 2],
    /// Whether a current was seen; if not, its sensor is missing, or setting "current sensor" should be 0.
    pub has_current: bool,
    /// Whether the polarity was turned round.
    pub turned_round: bool,
}

/// The low duty, in parts of the highest that is allowed, and how long it may take to move the shaft.
const LOW: f64 = 0.4;
const LOW_TIME: Duration = Duration::from_millis(300);
/// Then the duty rises to the highest, and stays a moment.
const RISE: Duration = Duration::from_millis(60);
const MORE_TIME: Duration = Duration::from_millis(110);
/// So many counts are enough; at the end these are: an encoder may stand on an edge, a potentiometer is noisy.
const PLENTY: i32 = 24;
const ENOUGH_OF_ENCODER: i32 = 3;
pub(super) const ENOUGH_OF_POTENTIOMETER: i32 = 10;
/// A/D counts of a current that is one.
const CURRENT: i32 = 12;
/// How long a shaft may take to stand still again.
pub(super) const REST: Duration = Duration::from_secs(3);

/// Checks the wiring of a motor with no more duty than this, 0 to 1; turns its polarity round if that is wrong
/// and `may_turn_round`.
///
/// The highest duty is driven for a tenth of a second, and only if three tenths of two fifths of it move nothing.
pub fn check(motor: Number, most: f64, may_turn_round: bool) -> Job<Checked> {
    Job::new(move |shared| async move {
        let mut hand = Hand::new(shared, motor);
        match once(&mut hand, most).await {
            Err(Refused::WrongWay) if may_turn_round => {}
            checked => return checked,
        }
        hand.begin("turns its polarity round");
        let number = numbered(POLARITY, motor);
        let was = hand.get(number).await?;
        hand.set(&[(number, if was == 0 { 1 } else { 0 })]).await?;
        // Nothing else shows that it helped.
        match once(&mut hand, most).await {
            Ok(checked) => Ok(Checked { turned_round: true, ..checked }),
            refused => set_back(refused, hand.set(&[(number, was)]).await),
        }
    })
}

async fn once(hand: &mut Hand, most: f64) -> Result<Checked, Refused> {
    hand.begin("reads its settings");
    let before = Before::read(hand).await?;
    let checked = match before.prepare(hand, most).await {
        Ok(most) => both_ways(hand, &before, most).await,
        Err(refused) => Err(refused),
    };
    let off = hand.end().await;
    let back = before.restore(hand, &[]).await;
    set_back(checked, off.and(back))
}

/// Drives both ways for a moment each.
pub(super) async fn both_ways(
    hand: &mut Hand,
    before: &Before,
    most: f64,
) -> Result<Checked, Refused> {
    hand.says("checks its wiring");
    let rising = one_way(hand, before, most, 1).await?;
    let falling = one_way(hand, before, most, -1).await?;
    let has_current = rising.current.max(falling.current) >= CURRENT;
    Ok(Checked { ways: [rising, falling], has_current, turned_round: false })
}

/// What was seen of a shaft on one way.
struct Seen {
    sign: i32,
    rest: ChannelState,
    last: ChannelState,
    current: i32,
}

impl Seen {
    /// Counts, positive if they went as they should.
    fn moved(&self) -> i32 {
        self.last.position.wrapping_sub(self.rest.position).wrapping_mul(self.sign)
    }

    /// Whether that is plenty.
    fn sees(&mut self, at: &ChannelState) -> bool {
        self.last = *at;
        self.current = self.current.max(i32::from(at.current) - i32::from(self.rest.current));
        self.moved().saturating_abs() >= PLENTY
    }
}

async fn one_way(hand: &mut Hand, before: &Before, most: f64, sign: i32) -> Result<Way, Refused> {
    let rest = hand.state().await?;
    let mut seen = Seen { sign, rest, last: rest, current: 0 };
    let duty = |part: f64| duty_of(before, f64::from(sign) * part * most);
    hand.drive(duty(LOW), Duration::ZERO).await?;
    hand.watch(hand.now() + LOW_TIME, |at| seen.sees(at)).await?;
    let enough = if before.encoder { ENOUGH_OF_ENCODER } else { ENOUGH_OF_POTENTIOMETER };
    let is_low = seen.moved().saturating_abs() >= enough;
    if !is_low {
        hand.drive(duty(1.0), RISE).await?;
        hand.watch(hand.now() + MORE_TIME, |at| seen.sees(at)).await?;
    }
    let (moved, current) = (seen.moved(), seen.current);
    let way = Way { moved, current, duty: if is_low { LOW * most } else { most } };
    if moved <= -enough {
        return Err(Refused::WrongWay);
    }
    if moved < enough {
        return Err(if current >= CURRENT { Refused::Stuck } else { Refused::Dead });
    }
    hand.rest(REST).await?;
    Ok(way)
}
