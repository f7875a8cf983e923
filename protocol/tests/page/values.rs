//! Numbers that stand in the words of a row.

use protocol::arcos::{ArmCommand, Joints, MAX_RECEIVED, MAX_SENT, START, StatusRequest};
use protocol::cm5::{Limits, encode};
use protocol::extension::{Description, flag};
use protocol::pms5005::{
    CHANNELS, Channel, Command, ETX, LcdFrame, Loop, Method, Polarity, Quantity, RES_NO_ACK,
    RID_HOST, RID_PMS5005, STX, Scope, Sensor,
};

use crate::text::{PAGE, bytes, table};

/// The row of the table under this heading in which a cell of this column is so.
fn row(title: &str, first_column: &str, column: usize, cell: &str) -> Vec<&'static str> {
    let rows = table(title, first_column);
    rows.into_iter().find(|row| row[column] == cell).unwrap_or_else(|| panic!("{title}: {cell}"))
}

fn hex(bytes: &[u8]) -> String {
    let shown: Vec<_> = bytes.iter().map(|byte| format!("{byte:02X}")).collect();
    shown.join(" ")
}

#[test]
fn numbers_have_the_ranges_that_the_wire_takes() {
    let rows = table("Numbers and units", "quantity");
    for (name, quantity) in [
        ("velocity asked for", Quantity::Velocity),
        ("PWM", Quantity::Pwm),
        ("position", Quantity::Position),
        ("servo position", Quantity::Servo),
    ] {
        let (low, high) = quantity.range();
        let row = rows.iter().find(|row| row[0] == name).expect(name);
        assert!(row[1].contains(&format!("{low} to {high}")), "{name}: {}", row[1]);
    }
}

#[test]
fn marks_and_addresses_are_those_of_the_wire() {
    let value = |field| row("The frame", "byte", 1, field)[2];
    assert_eq!((value("start"), value("end")), (&*hex(&STX), &*hex(&ETX)));
    assert!(value("RID").contains(&format!(": {RID_HOST} the host, {RID_PMS5005} the board;")));
    assert!(
        value("RES").contains(&format!("from a host: {RES_NO_ACK} asks for no acknowledgement"))
    );
    let arcos = |field| row("The packet", "byte", 1, field)[2];
    assert_eq!(arcos("start"), hex(&START));
    let (received, sent) = (MAX_RECEIVED - 3, MAX_SENT - 3);
    assert!(
        arcos("count")
            .ends_with(&format!("3 to {received} from a host, {sent} at the most from the arm"))
    );
    let packet = encode([[0]], &mut [0; 6]).unwrap().to_vec();
    assert_eq!(row("Its packet", "byte", 1, "start")[2], hex(&packet[..2]));
}

#[test]
fn the_values_of_sub_commands_are_those_of_the_wire() {
    let data =
        |sub: u8| row("System parameters (DID 7)", "sub-command", 0, &format!("{sub:02X}"))[2];
    let (positive, negative) = (Polarity::Positive.number(), Polarity::Negative.number());
    assert_eq!(data(0x06), format!("channel; {positive} positive, {negative:X} negative"));
    assert!(
        data(Loop::Position.number())
            .contains("one or more of 01 Kp, 02 Kd, 03 Ki, each with 2 bytes")
    );
    assert_eq!(data(Loop::Velocity.number()), "the same");
    let [one, two, encoder] =
        [Sensor::SinglePotentiometer, Sensor::DualPotentiometer, Sensor::Encoder]
            .map(Sensor::number);
    assert_eq!(
        data(0x0D),
        format!("channel; {one} one potentiometer, {two} two, {encoder} the encoder")
    );
    let [pwm, position, velocity] =
        [Method::Pwm, Method::Position, Method::Velocity].map(Method::number);
    assert_eq!(data(0x0E), format!("channel; {pwm} PWM, {position} position, {velocity} velocity"));
    assert_eq!(data(0x13), "0 off, 1 on");
}

#[test]
fn suspensions_and_pictures_have_the_numbers_of_the_wire() {
    let did = |did: &str| row("Commands", "DID", 0, did)[2];
    assert!(did("30").starts_with("1 byte for all: 0 suspends, 1 resumes."));
    assert!(did("30").ends_with("whom: 0 to 5 a motor, 6 to 11 a servo"));
    for (number, channel) in (0..).zip(Channel::ALL) {
        for (whom, scope) in [(number, Scope::Motor(channel)), (6 + number, Scope::Servo(channel))]
        {
            for (mode, run) in [(0, false), (1, true)] {
                assert_eq!(Command::parse(30, &[mode, whom]), Ok(Command::Run { scope, run }));
            }
        }
    }
    assert!(Command::parse(30, &[0, 12]).is_err() && CHANNELS == 6);
    assert!(did("23").starts_with(&format!("frame number, {} bytes", LcdFrame::COLUMNS)));
    assert!(PAGE.contains(&format!("Frame number 0 to {}:", LcdFrame::FRAMES - 1)));
}

#[test]
fn requests_name_their_sub_command_and_their_answer() {
    for row in table("Requests", "DID") {
        let is_change = row[0] == "7";
        let answer = if is_change { "101" } else { row[0] };
        assert!(row[4].starts_with(answer), "{}: {}", row[1], row[4]);
        if is_change {
            let sub = format!("{:X}", bytes(row[3])[0]);
            assert!(row[2].split(',').next() == Some(&*sub), "{}: {}", row[1], row[2]);
        }
    }
    let flags = row("DID 102: machine state", "bytes", 1, "flags")[3];
    for (bit, means) in [
        (flag::LINK_LOST, "the host is silent"),
        (flag::OBSTACLE, "an obstacle"),
        (flag::FAULT, "a fault is latched"),
    ] {
        assert!(flags.contains(&format!("bit {} {means}", bit.trailing_zeros())), "{flags}");
    }
    let name = row("DID 96: setting", "bytes", 1, "name")[3];
    assert!(name.starts_with(&format!("{} bytes at most", Description::LONGEST_NAME)));
}

#[test]
fn arguments_of_the_arm_have_the_values_of_the_wire() {
    let means = |name| row("Commands of the arm", "number", 1, name)[4];
    let int = |number, value: u8| ArmCommand::parse(number, &[0x3B, value, 0]);
    assert_eq!(means("STATUS"), "ARMpac: 0 no more, 1 once, 2 one before every standard packet");
    for (value, request) in
        [(0, StatusRequest::Stop), (1, StatusRequest::Once), (2, StatusRequest::Stream)]
    {
        assert_eq!(int(71, value), Ok(ArmCommand::Status(request)));
    }
    assert_eq!(means("POWER"), "1 servo power on, 0 home and off");
    assert_eq!(
        (int(74, 1), int(74, 0)),
        (Ok(ArmCommand::Power(true)), Ok(ArmCommand::Power(false)))
    );
    assert!(means("HOME").contains("above 6 all") && means("STOP").contains("255 all"));
    assert_eq!(
        (int(75, 7), int(79, 255)),
        (Ok(ArmCommand::Home(Joints::All)), Ok(ArmCommand::Stop(Joints::All)))
    );
    assert!(int(75, 0).is_err() && int(79, 7).is_err(), "as under what we chose");
}

#[test]
fn limits_of_a_cm5_are_those_that_a_servo_takes() {
    let answer = row("Its messages", "message", 0, "answer")[2];
    assert!(
        answer.contains("2 us each, 0 to 254")
            && answer.contains("2 bytes each, 0 to 1023, CW not above CCW")
    );
    assert!(
        Limits::new(1023, 1023).is_ok()
            && Limits::new(0, 1024).is_err()
            && Limits::new(2, 1).is_err()
    );
}
