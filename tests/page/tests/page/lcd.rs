//! The LCD's pixels: from a picture's file to the board and back to the page.

use page::Desk;

const WIDTH: usize = 128;
const HEIGHT: usize = 64;

/// A picture without any symmetry: a frame on two sides, a block, and specks.
fn is_dark(x: usize, y: usize) -> bool {
    x == 0
        || y == HEIGHT - 1
        || (20..30).contains(&x) && y < 9
        || (x * x + 7 * x * y + 3 * y).is_multiple_of(11)
}

/// All of its pixels, from the top.
pub fn picture() -> Vec<bool> {
    (0..WIDTH * HEIGHT).map(|at| is_dark(at % WIDTH, at / WIDTH)).collect()
}

/// The picture as the file of an uncompressed BMP: 24 bits a pixel, the lowest row first.
pub fn bmp() -> Vec<u8> {
    const HEAD: usize = 54;
    let size = HEAD + 3 * WIDTH * HEIGHT;
    let mut file = b"BM".to_vec();
    let words = [size, 0, HEAD, 40, WIDTH, HEIGHT, 1 | 24 << 16, 0, 0, 0, 0, 0, 0];
    file.extend(words.into_iter().flat_map(|word| (word as u32).to_le_bytes()));
    for y in (0..HEIGHT).rev() {
        file.extend((0..WIDTH).flat_map(|x| [if is_dark(x, y) { 0 } else { 255 }; 3]));
    }
    assert_eq!(file.len(), size);
    file
}

/// What the board's LCD holds, after the manual's DID 23: sixteen parts of 64 columns; even ones are the left
/// half, odd ones the right, from the top; a column's least significant bit is on top.
pub fn held(hex: &str) -> Vec<bool> {
    let byte = |at: usize| u8::from_str_radix(&hex[2 * at..2 * at + 2], 16).unwrap();
    let pixel = |x: usize, y: usize| byte((y / 8 * 2 + x / 64) * 64 + x % 64) >> (y % 8) & 1 == 1;
    (0..WIDTH * HEIGHT).map(|at| pixel(at % WIDTH, at / WIDTH)).collect()
}

/// What the page's canvas shows.
fn shown(desk: &Desk) -> Vec<bool> {
    let script = "const canvas = document.querySelector('#lcd');
        const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
        return Array.from({ length: data.length / 4 }, (_, i) => data[4 * i + 1] < 128 ? '1' : '0').join('');";
    desk.js(script, &[]).as_str().unwrap().chars().map(|pixel| pixel == '1').collect()
}

#[test]
fn a_picture_is_on_the_boards_lcd_pixel_by_pixel_and_on_the_page() {
    let desk = Desk::open();
    let truth = || held(desk.board.truth()["lcd"].as_str().unwrap());
    let picture = picture();
    desk.arm();
    desk.tab("io");
    assert_ne!(truth(), picture);
    let file = std::env::temp_dir().join(format!("page-{}.bmp", std::process::id()));
    std::fs::write(&file, bmp()).unwrap();
    desk.type_into("#picture", file.to_str().unwrap());
    desk.until_text("#panel-io", "Not sent yet");
    std::fs::remove_file(&file).unwrap();
    desk.click("#send-lcd");
    desk.until_text("#panel-io", "As the virtual board shows it");
    page::until("the picture on the LCD", || (truth() == picture).then_some(()));
    page::until("the picture on the page", || (shown(&desk) == picture).then_some(()));

    // A page that never saw the file.
    desk.open_page();
    page::until("the picture on a new page", || (shown(&desk) == picture).then_some(()));
}
