-- Finger script for a WSG gripper: streamed finger speed over the binary command interface.
--
-- Load it with the gripper's web interface (Scripting > Interactive Scripting) and let it start at power-up. It answers
--   B0  read              B2  move with a speed [mm/s], negative closes
-- Each request has nine bytes: 00, f32 without a use, speed f32 (little-endian). Each reply: status u16, width f32, speed f32.
-- A speed that is not renewed within WATCHDOG_MS becomes zero: a cable pull while closing stops the fingers.

local READ, SPEED = 0xB0, 0xB2
local WATCHDOG_MS = 100

cmd.register(READ)
cmd.register(SPEED)

local renewed, streaming = 0, false

while true do
    if cmd.available() > 0 then
        local id, payload = cmd.read()
        local speed = bton({payload[6], payload[7], payload[8], payload[9]})
        if id == SPEED then
            streaming = speed ~= 0
            renewed = system.tickcount()
            mc.speed(speed)
        end
        cmd.send(id, etob(E_SUCCESS), ntob(mc.position()), ntob(mc.speed()))
    elseif streaming and system.tickcount() - renewed > WATCHDOG_MS then
        streaming = false
        mc.speed(0)
    end
end
