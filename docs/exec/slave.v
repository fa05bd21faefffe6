`timescale 1ns / 1ns

// An encoder with 16 bits. Positions go up by 1000 a frame.
module encoder #(parameter TIMEOUT = 20000) (input ma, output reg slo);
  reg [15:0] position = 0;
  reg        armed = 0;
  reg [27:0] shown;
  integer    edges = 0;

  function [5:0] crc6(input [17:0] data);
    integer i;
    begin
      crc6 = 0;
      for (i = 17; i >= 0; i = i - 1)
        crc6 = {crc6[4:0], 1'b0} ^ (data[i] ^ crc6[5] ? 6'h03 : 6'h00);
    end
  endfunction

  initial slo = 1;

  always @(negedge ma) armed = 1;

  // Rising edge 1 is LAT, then come Ack, start, CDS, the position, nE, nW, the inverted CRC, and zeros until the timeout.
  always @(posedge ma) if (armed) begin
    if (edges == 0) begin
      position = position + 1000;
      shown = {4'b1010, position, 2'b11, ~crc6({position, 2'b11})};
    end
    slo = shown[27];
    shown = shown << 1;
    edges = edges + 1;
  end

  // Each edge of MA begins the timeout anew.
  always @(ma) disable timer;
  always begin : timer
    #TIMEOUT;
    slo = 1;
    armed = 0;
    edges = 0;
    @(ma);
  end
endmodule

// The two wires over stdin and stdout: a byte a tick each way. The part to take for a design of your own.
module wires #(parameter TICK = 8) (output reg ma, input slo);
  localparam STDIN = 32'h8000_0000, STDOUT = 32'h8000_0001;
  integer level;

  initial begin
    ma = 1;
    level = $fgetc(STDIN);
    while (level >= 0) begin
      ma = level == "1";
      #TICK;
      // An x or z goes out as such, and biss says so.
      $fwrite(STDOUT, "%b", slo);
      $fflush(STDOUT);
      level = $fgetc(STDIN);
    end
    $finish(0);
  end
endmodule

module bench;
  wire ma, slo;
  wires #(.TICK(8)) wires (.ma(ma), .slo(slo));
  encoder encoder (.ma(ma), .slo(slo));
endmodule
