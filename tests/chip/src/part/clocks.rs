//! Clock enables and reset lines: what answers only while its enable stands in the clock controller,
//! and what a bit of it puts back (RM0090 sections 7.3.5 to 7.3.14).
//!
//! rigless states them for its own memory map and does not tell them, so they are stated again for
//! this one.

/// Instance, bus (the beginning of the registers' names), field of the enable, field of the reset.
/// ST's file spells USART2's and USART3's reset bits without the S.
pub const GATES: [(&str, &str, &str, &str); 31] = [
    ("GPIOA", "AHB1", "GPIOAEN", "GPIOARST"),
    ("GPIOB", "AHB1", "GPIOBEN", "GPIOBRST"),
    ("GPIOC", "AHB1", "GPIOCEN", "GPIOCRST"),
    ("GPIOD", "AHB1", "GPIODEN", "GPIODRST"),
    ("GPIOE", "AHB1", "GPIOEEN", "GPIOERST"),
    ("GPIOF", "AHB1", "GPIOFEN", "GPIOFRST"),
    ("GPIOG", "AHB1", "GPIOGEN", "GPIOGRST"),
    ("GPIOH", "AHB1", "GPIOHEN", "GPIOHRST"),
    ("GPIOI", "AHB1", "GPIOIEN", "GPIOIRST"),
    ("DMA1", "AHB1", "DMA1EN", "DMA1RST"),
    ("DMA2", "AHB1", "DMA2EN", "DMA2RST"),
    ("TIM2", "APB1", "TIM2EN", "TIM2RST"),
    ("TIM3", "APB1", "TIM3EN", "TIM3RST"),
    ("TIM4", "APB1", "TIM4EN", "TIM4RST"),
    ("TIM5", "APB1", "TIM5EN", "TIM5RST"),
    ("TIM12", "APB1", "TIM12EN", "TIM12RST"),
    ("USART2", "APB1", "USART2EN", "UART2RST"),
    ("USART3", "APB1", "USART3EN", "UART3RST"),
    ("UART4", "APB1", "UART4EN", "UART4RST"),
    ("UART5", "APB1", "UART5EN", "UART5RST"),
    ("I2C1", "APB1", "I2C1EN", "I2C1RST"),
    ("PWR", "APB1", "PWREN", "PWRRST"),
    ("TIM1", "APB2", "TIM1EN", "TIM1RST"),
    ("TIM8", "APB2", "TIM8EN", "TIM8RST"),
    ("USART1", "APB2", "USART1EN", "USART1RST"),
    ("USART6", "APB2", "USART6EN", "USART6RST"),
    ("ADC1", "APB2", "ADC1EN", "ADCRST"),
    ("C_ADC", "APB2", "ADC1EN", "ADCRST"),
    ("ADC2", "APB2", "ADC2EN", "ADCRST"),
    ("ADC3", "APB2", "ADC3EN", "ADCRST"),
    ("SYSCFG", "APB2", "SYSCFGEN", "SYSCFGRST"),
];

/// The register that holds an enable, and the one that holds a reset.
pub fn registers(bus: &str) -> (&'static str, &'static str) {
    match bus {
        "AHB1" => ("AHB1ENR", "AHB1RSTR"),
        "APB1" => ("APB1ENR", "APB1RSTR"),
        _ => ("APB2ENR", "APB2RSTR"),
    }
}
