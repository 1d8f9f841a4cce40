// SPDX-License-Identifier: Apache-2.0
// The firmware on avr8js, a simulator of the ATmega328P that shares nothing with simavr:
//   node run.mjs FIRMWARE.hex WORLD.json > BYTES
// WORLD.json: {"seconds", "tau" [cycles], "noise" [ADC steps], "seed", "ratio": [[begin [s], [256 shares
// of the supply, 16 for each row]], ...]}. What is wired to the chip is as in chip.c, and so is the
// noise, number by number.
import { readFileSync, writeSync } from "node:fs";
import {
  adcConfig, AVRADC, AVRClock, AVRIOPort, AVRTimer, AVRUSART, AVRWatchdog, avrInstruction,
  clockConfig, CPU, portBConfig, portDConfig, timer0Config, usart0Config, watchdogConfig,
} from "avr8js";

const CLOCK = 16e6; // Hz
const FLASH = 0x8000; // bytes
const MCUSR = 0x54, POWER_ON = 1;
const STEPS = 1024; // of the ADC, in the voltage of the supply
const SAMPLE_CYCLES = 12; // from the begin of a conversion until the input is held
const BYTE_CYCLES = 160; // that the serial line takes

const [hexFile, worldFile] = process.argv.slice(2);
const world = JSON.parse(readFileSync(worldFile, "utf8"));

function flashOf(hex) {
  const bytes = new Uint8Array(FLASH).fill(0xff);
  for (const line of hex.split("\n").filter((each) => each.startsWith(":"))) {
    const record = Buffer.from(line.trim().slice(1), "hex");
    if (record[3] === 0) bytes.set(record.subarray(4, 4 + record[0]), record.readUInt16BE(1));
  }
  return new Uint16Array(bytes.buffer);
}

const cpu = new CPU(flashOf(readFileSync(hexFile, "utf8")));
const clock = new AVRClock(cpu, CLOCK, clockConfig);
new AVRWatchdog(cpu, watchdogConfig, clock);
new AVRTimer(cpu, timer0Config);
const portB = new AVRIOPort(cpu, portBConfig);
const portD = new AVRIOPort(cpu, portDConfig);
const usart = new AVRUSART(cpu, usart0Config, CLOCK);
const adc = new AVRADC(cpu, adcConfig);
cpu.data[MCUSR] = POWER_ON;

// --- multiplexers, fabric, the ADC's input ---
let ratio = new Array(256).fill(0);
let row = 0, col = 0, level = 0, target = 0, switched = 0, seed = world.seed;

const levelAt = (when) => target + (level - target) * Math.exp(-(when - switched) / world.tau);

function select() {
  level = levelAt(cpu.cycles);
  switched = cpu.cycles;
  target = ratio[16 * row + col];
}

portB.addListener((value) => { row = value & 15; select(); });
portD.addListener((value) => { col = value >> 4; select(); });

function noise() {
  seed ^= seed << 13;
  seed ^= seed >>> 17;
  seed ^= seed << 5;
  const sum = (seed & 255) + ((seed >>> 8) & 255) + ((seed >>> 16) & 255) + (seed >>> 24);
  return (sum - 510) / 147.8;
}

adc.onADCRead = () => {
  let steps = levelAt(cpu.cycles + SAMPLE_CYCLES) * STEPS + 0.5;
  if (world.noise > 0) steps += world.noise * noise();
  const reading = Math.min(Math.max(Math.floor(steps), 0), STEPS - 1);
  cpu.addClockEvent(() => adc.completeADCRead(reading), adc.sampleCycles);
};

// --- serial line: a shift register with a buffer before it; avr8js has only one of them ---
const sent = [];
let shifted = 0;
cpu.writeHooks[usart0Config.UDR] = (value) => {
  sent.push(value);
  cpu.clearInterrupt(usart.UDRE);
  const begins = Math.max(shifted, cpu.cycles);
  shifted = begins + BYTE_CYCLES;
  cpu.addClockEvent(() => cpu.setInterruptFlag(usart.UDRE), begins - cpu.cycles + 1);
};

const scenes = world.ratio.map(([begin, values]) => [begin * CLOCK, values]);
const end = world.seconds * CLOCK;
while (cpu.cycles < end) {
  if (scenes.length && cpu.cycles >= scenes[0][0]) {
    ratio = scenes.shift()[1];
    select();
  }
  avrInstruction(cpu);
  cpu.tick();
}
writeSync(1, Buffer.from(sent));
