// node_ports.js PORT: SerialPort.list() finds it; opened at 7E1 it has signals, and sends back.
"use strict";
const { promisify } = require("util");
const { SerialPort } = require("serialport");

async function main(path) {
  const found = (await SerialPort.list()).find((port) => port.path === path);
  if (!found) throw new Error(`${path} is not listed`);
  for (const key of ["path", "vendorId", "productId", "serialNumber"]) console.log(`${key}: ${found[key]}`);
  if (found.vendorId !== "0403" || found.productId !== "6001") throw new Error("another adapter");

  const port = new SerialPort({ path, baudRate: 9600, dataBits: 7, parity: "even", autoOpen: false });
  const call = (name) => promisify(port[name]).bind(port);
  await call("open")();
  await call("set")({ rts: true, dtr: true, brk: false });
  const { cts, dsr, dcd } = await call("get")();
  console.log(`signals: cts ${cts} dsr ${dsr} dcd ${dcd}`);
  const words = "who is there";
  let heard = "";
  const answered = new Promise((resolve) => port.on("data", (data) => (heard += data).length >= words.length && resolve()));
  await call("write")(words);
  await call("drain")();
  await answered;
  console.log(`sent back: ${heard}`);
  await call("close")();
}

main(process.argv[2]).catch((error) => {
  console.error(error.message);
  process.exit(1);
});
